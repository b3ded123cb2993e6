// SPDX-License-Identifier: GPL-3.0-or-later
//! The error bound of section 2.2.

/// Bound on the error of a multipole expansion truncated at `p` (section 2.2).
///
/// `strength` is the sum of |q| = w B over the sources, `r_y` the greatest distance of a source
/// from the centre and `r_x` the distance of the receiver, in any one unit of length. The bound is
///
/// ```text
/// strength (r_x + r_y)^2 / r_x^4  sum_(n > p) (r_y / r_x)^n C(n + 3, 3)
/// ```
///
/// with the paper's own generosity: the kernel's 1/pi is left out. It is infinite when r_y >= r_x.
pub fn error_bound(p: usize, strength: f64, r_y: f64, r_x: f64) -> f64 {
    if r_y >= r_x {
        return f64::INFINITY;
    }
    strength * (r_x + r_y).powi(2) / r_x.powi(4) * gegenbauer_tail(p, r_y / r_x)
}

/// sum_(n > p) C(n + 3, 3) t^n in closed form, free of cancellation.
///
/// C(n + 3, 3) counts the ways to share n = (p + 1) + k among four; those that give p + 1 to the
/// first i + 1 of them leave a geometric series for the others:
/// t^(p+1) sum_(i=0..3) C(p + i, i) / (1 - t)^(4 - i).
fn gegenbauer_tail(p: usize, t: f64) -> f64 {
    let sum: f64 = (0..4).map(|i| super::simplex::binomial(p + i, i) / (1.0 - t).powi(4 - i as i32)).sum();
    t.powi(p as i32 + 1) * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tail_matches_its_series() {
        for p in [0, 1, 5, 20] {
            for t in [0.0f64, 0.1, 0.5, 0.9] {
                let term = |n: usize| super::super::simplex::binomial(n + 3, 3) * t.powi(n as i32);
                let series: f64 = (p + 1..4000).map(term).sum();
                assert!((gegenbauer_tail(p, t) - series).abs() <= 1e-10 * series, "{p} {t}");
            }
        }
    }

    #[test]
    fn no_bound_inside_the_sources() {
        assert_eq!(error_bound(4, 1.0, 1.0, 1.0), f64::INFINITY);
    }
}
