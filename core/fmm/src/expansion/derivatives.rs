// SPDX-License-Identifier: GPL-3.0-or-later
//! All normalised derivatives D^gamma f / gamma! of a radial function, by a short recurrence.
//!
//! Along a line d + t h both functions satisfy a first-order equation in t,
//! with q(t) = |d|^2 + 2 t d.h + t^2 |h|^2:
//!
//! ```text
//! f = log|d|:      q f' = d.h + t |h|^2
//! f = |d|^-nu:     q f' = -nu (d.h + t |h|^2) f
//! ```
//!
//! Equal powers of t give the homogeneous polynomial of degree n in h, whose coefficients are the
//! normalised derivatives of order n, from those of orders n - 1 and n - 2. Normalised derivatives
//! fall like |d|^-n, so that nothing overflows, whatever the order.

use super::simplex::{Exponent, degree, exponents, index, lowered};

/// The radial function to derive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radial {
    /// log|d|, from which the whole kernel follows.
    Logarithm,
    /// |d|^-4, the scalar kernel of (eq 4).
    InverseFourth,
}

impl Radial {
    fn value(self, u: f64) -> f64 {
        match self {
            Radial::Logarithm => 0.5 * u.ln(),
            Radial::InverseFourth => 1.0 / (u * u),
        }
    }

    /// nu of |d|^-nu; the logarithm obeys the equation of nu = 0 with a right-hand side.
    fn nu(self) -> f64 {
        match self {
            Radial::Logarithm => 0.0,
            Radial::InverseFourth => 4.0,
        }
    }
}

/// One step of the recurrence: the terms that make the derivative at one exponent gamma.
/// Terms that are not there have factor 0 (and point at order zero).
#[derive(Clone, Copy, Debug, Default)]
struct Step {
    /// factor and place of gamma - e_axis, for each axis
    first: [(f64, usize); 3],
    /// factor and place of gamma - 2 e_axis, for each axis
    second: [(f64, usize); 3],
    /// the logarithm's right-hand side: the factor of d_axis, for each axis ...
    linear: [f64; 3],
    /// ... and of one
    constant: f64,
}

/// The recurrence for all orders up to `order`, ready to run at many points.
#[derive(Clone, Debug)]
pub struct Derivatives {
    radial: Radial,
    steps: Vec<Step>,
}

impl Derivatives {
    pub fn new(radial: Radial, order: usize) -> Self {
        let steps = exponents(order).into_iter().skip(1).map(|gamma| step(radial, gamma));
        Self { radial, steps: steps.collect() }
    }

    /// Normalised derivatives at `LANES` points d, one output row an exponent (order of
    /// [`index`]); `d` is `[axis][lane]`.
    #[inline(always)]
    pub fn evaluate<const LANES: usize>(&self, d: &[[f64; LANES]; 3], out: &mut Vec<[f64; LANES]>) {
        let u: [f64; LANES] = std::array::from_fn(|l| d[0][l] * d[0][l] + d[1][l] * d[1][l] + d[2][l] * d[2][l]);
        out.clear();
        out.push(u.map(|u| self.radial.value(u)));
        let inverse = u.map(|u| 1.0 / u);
        for step in &self.steps {
            let mut sum = [step.constant; LANES];
            for axis in 0..3 {
                let (first, lower) = (step.first[axis].0, &out[step.first[axis].1]);
                let (second, lowest) = (step.second[axis].0, &out[step.second[axis].1]);
                for l in 0..LANES {
                    let slope = first * lower[l] + step.linear[axis];
                    sum[l] += d[axis][l] * slope + second * lowest[l];
                }
            }
            out.push(std::array::from_fn(|l| sum[l] * inverse[l]));
        }
    }

    /// Normalised derivatives at one point.
    pub fn at(&self, d: [f64; 3]) -> Vec<f64> {
        let mut out = Vec::new();
        self.evaluate(&d.map(|x| [x]), &mut out);
        out.into_iter().map(|[value]| value).collect()
    }
}

/// The terms of
///
/// ```text
/// n |d|^2 f_gamma = -(2 (n - 1) + nu) sum d_i f_(gamma - e_i) - (n - 2 + nu) sum f_(gamma - 2 e_i)
///                   + (d.h + |h|^2)_gamma, for the logarithm only.
/// ```
fn step(radial: Radial, gamma: Exponent) -> Step {
    let n = degree(gamma) as f64;
    let nu = radial.nu();
    let mut step = Step::default();
    for axis in 0..3 {
        let Some(lower) = lowered(gamma, axis) else { continue };
        step.first[axis] = (-(2.0 * (n - 1.0) + nu) / n, index(lower));
        if let Some(lowest) = lowered(lower, axis) {
            step.second[axis] = (-(n - 2.0 + nu) / n, index(lowest));
        }
        if radial == Radial::Logarithm && degree(lower) == 0 {
            step.linear[axis] = 1.0;
        }
        if radial == Radial::Logarithm && lower[axis] == 1 && degree(lower) == 1 {
            step.constant = 0.5;
        }
    }
    step
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Taylor polynomial must reproduce the function near d.
    fn taylor_error(radial: Radial, order: usize) -> f64 {
        let d = [1.1, -3.0, 2.2];
        let h: [f64; 3] = [0.31, 0.22, -0.43];
        let coefficients = Derivatives::new(radial, order).at(d);
        let power = |alpha: Exponent| -> f64 { (0..3).map(|axis| h[axis].powi(alpha[axis] as i32)).product() };
        let sum: f64 = exponents(order).iter().zip(&coefficients).map(|(&a, c)| c * power(a)).sum();
        let u: f64 = (0..3).map(|axis| (d[axis] + h[axis]).powi(2)).sum();
        (sum / radial.value(u) - 1.0).abs()
    }

    #[test]
    fn taylor_series_converges() {
        for radial in [Radial::Logarithm, Radial::InverseFourth] {
            assert!(taylor_error(radial, 4) > 1e-7);
            assert!(taylor_error(radial, 42) < 1e-14);
        }
    }
}
