// SPDX-License-Identifier: GPL-3.0-or-later
//! The basis of (eq 4): r^n Y_(n-2j)^m for n <= p, as real homogeneous polynomials.
//!
//! r^n Y_(n-2j)^m = r^(2j) R_(n-2j)^m with R a solid harmonic: a homogeneous polynomial of degree
//! n. Over j and m they span all of these. Real and imaginary parts are taken in place of m and
//! -m, and each polynomial is scaled to norm one in Bombieri's inner product,
//!
//! ```text
//! < x^alpha, x^beta > = delta_alphabeta alpha! / n!
//! ```
//!
//! which does not change under rotations, so that different (j, m) are orthogonal. In monomials
//! scaled to norm one the change of basis is then an orthogonal matrix, its inverse is its
//! transpose, and it is well conditioned at any p. The reproducing kernel of that product,
//! (x . y)^n, ties the scaling to that of Y: see [`Harmonics::coefficient`].

use super::simplex::{Exponent, degree, exponents_of_degree, index, monomials, multinomial, raised};
use super::sparse::Sparse;

/// The polynomials Q_a, a = (n, j, m), in order of degree; each degree takes up the same rows as
/// the monomials of that degree.
#[derive(Clone, Debug)]
pub struct Harmonics {
    /// Q_a(x) = sum_alpha forward[a, alpha] x^alpha
    pub forward: Sparse,
    /// x^alpha = sum_a inverse[alpha, a] Q_a(x)
    pub inverse: Sparse,
    /// (n, j) of each row
    orders: Vec<(usize, usize)>,
}

impl Harmonics {
    /// All polynomials with n <= `truncation`.
    pub fn new(truncation: usize) -> Self {
        let mut rows: Vec<Row> = Vec::new();
        for n in 0..=truncation {
            let solid = solid_harmonics(n).into_iter().map(|q| Row { j: 0, q });
            let lower = n.checked_sub(2).map_or(0..0, degree_range);
            let raised = rows[lower].iter().map(|row| Row { j: row.j + 1, q: row.q.times_square() });
            let degree: Vec<Row> = solid.chain(raised).map(Row::normalised).collect();
            rows.extend(degree);
        }
        Self {
            forward: Sparse::from_rows(rows.iter().map(|row| row.q.terms())),
            inverse: inverse(&rows),
            orders: rows.iter().map(|row| (row.q.degree, row.j)).collect(),
        }
    }

    /// Number of polynomials.
    pub fn len(&self) -> usize {
        self.orders.len()
    }

    /// c_a in 1/|x - y|^4 = sum_a c_a r_x^(-2n-4) Q_a(x) Q_a(y), r_y < r_x (eq 4).
    ///
    /// pi e_n^j, divided by the ratio of Q Q to r^2n Y Y: 2^n (n - j + 1)! (3/2)_j / n!.
    pub fn coefficient(&self, a: usize) -> f64 {
        let (n, j) = self.orders[a];
        let powers = (1..=n).map(|k| 2.0 / k as f64);
        let factorial = (1..=n - j + 1).map(|k| k as f64);
        let rising = (0..j).map(|k| k as f64 + 1.5);
        powers.chain(factorial).chain(rising).product()
    }

    /// Reflections that change the sign of Q_a: bit `axis` for each axis of which it is odd.
    pub fn parity(&self, a: usize) -> u8 {
        let exponent = self.forward.row(a).first().map_or([0; 3], |&(place, _)| {
            let n = self.orders[a].0;
            exponents_of_degree(n).nth(place - degree_range(n).start).unwrap_or([0; 3])
        });
        (0..3).map(|axis| ((exponent[axis] % 2) as u8) << axis).sum()
    }
}

/// Places of the monomials (and of the Q) of degree exactly n.
fn degree_range(n: usize) -> std::ops::Range<usize> {
    n.checked_sub(1).map_or(0, monomials)..monomials(n)
}

struct Row {
    j: usize,
    q: Polynomial,
}

impl Row {
    fn normalised(self) -> Self {
        let norm = self.q.squared_norm().sqrt();
        Self { j: self.j, q: self.q.scaled(1.0 / norm) }
    }
}

/// x^alpha in terms of Q: the transpose of the orthogonal matrix, back in plain monomials.
fn inverse(rows: &[Row]) -> Sparse {
    let mut columns = vec![Vec::new(); rows.len()];
    for (a, row) in rows.iter().enumerate() {
        for (alpha, &value) in exponents_of_degree(row.q.degree).zip(&row.q.coefficients) {
            columns[index(alpha)].push((a, value / multinomial(alpha)));
        }
    }
    Sparse::from_rows(columns)
}

/// A homogeneous polynomial; coefficients in the order of its exponents.
#[derive(Clone)]
struct Polynomial {
    degree: usize,
    coefficients: Vec<f64>,
}

impl Polynomial {
    fn zero(degree: usize) -> Self {
        Self { degree, coefficients: vec![0.0; degree_range(degree).len()] }
    }

    fn place(alpha: Exponent) -> usize {
        index(alpha) - degree_range(degree(alpha)).start
    }

    /// self times x^power
    fn times(&self, power: Exponent) -> Self {
        let mut product = Self::zero(self.degree + degree(power));
        for (alpha, c) in exponents_of_degree(self.degree).zip(&self.coefficients) {
            let sum = std::array::from_fn(|axis| alpha[axis] + power[axis]);
            product.coefficients[Self::place(sum)] = *c;
        }
        product
    }

    /// self + factor other
    fn plus(mut self, factor: f64, other: &Self) -> Self {
        super::sparse::add_scaled(factor, &other.coefficients, &mut self.coefficients);
        self
    }

    /// (x^2 + y^2) self
    fn times_radial(&self) -> Self {
        self.times([2, 0, 0]).plus(1.0, &self.times([0, 2, 0]))
    }

    /// (x^2 + y^2 + z^2) self
    fn times_square(&self) -> Self {
        self.times_radial().plus(1.0, &self.times([0, 0, 2]))
    }

    fn scaled(mut self, factor: f64) -> Self {
        self.coefficients.iter_mut().for_each(|c| *c *= factor);
        self
    }

    /// The squared norm in Bombieri's inner product.
    fn squared_norm(&self) -> f64 {
        let terms = exponents_of_degree(self.degree).zip(&self.coefficients);
        terms.map(|(alpha, c)| c * c / multinomial(alpha)).sum()
    }

    /// (place among all monomials, coefficient)
    fn terms(&self) -> impl Iterator<Item = (usize, f64)> {
        degree_range(self.degree).zip(self.coefficients.iter().copied())
    }
}

/// Real and imaginary parts of (x + i y)^m.
fn sectorials(m: usize) -> [Polynomial; 2] {
    let mut one = Polynomial::zero(0);
    one.coefficients[0] = 1.0;
    (0..m).fold([one, Polynomial::zero(0)], |[re, im], _| {
        let [x, y] = [0, 1].map(|axis| raised([0; 3], axis));
        [re.times(x).plus(-1.0, &im.times(y)), im.times(x).plus(1.0, &re.times(y))]
    })
}

/// The 2l + 1 real solid harmonics of degree l:
/// (x + i y)^m sum_k (-1/4)^k (x^2 + y^2)^k z^(l-m-2k) / (k! (m + k)! (l - m - 2k)!).
fn solid_harmonics(l: usize) -> Vec<Polynomial> {
    let of_order = |m| sectorials(m).into_iter().take(if m == 0 { 1 } else { 2 });
    (0..=l).flat_map(|m| of_order(m).map(move |s| solid_harmonic(l, m, s))).collect()
}

fn solid_harmonic(l: usize, m: usize, sectorial: Polynomial) -> Polynomial {
    let (mut sum, mut radial, mut factor) = (Polynomial::zero(l), sectorial, 1.0);
    for k in 0..=(l - m) / 2 {
        let rest = l - m - 2 * k;
        sum = sum.plus(factor, &radial.times([0, 0, rest]));
        radial = radial.times_radial();
        factor *= -0.25 * (rest * rest.saturating_sub(1)) as f64 / ((k + 1) * (m + k + 1)) as f64;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_is_inverse() {
        let harmonics = Harmonics::new(20);
        assert_eq!(harmonics.len(), monomials(20));
        for a in [0, 3, 200, 1000, 1770] {
            let mut unit = vec![0.0; harmonics.len()];
            unit[a] = 1.0;
            let (mut there, mut back) = (vec![0.0; unit.len()], vec![0.0; unit.len()]);
            harmonics.inverse.apply(1, &unit, &mut there);
            harmonics.forward.apply(1, &there, &mut back);
            for (i, x) in back.iter().enumerate() {
                assert!((x - unit[i]).abs() < 1e-13, "{a} {i} {x}");
            }
        }
    }

    #[test]
    fn solid_harmonics_have_no_laplacian() {
        for q in solid_harmonics(20) {
            let mut laplacian = Polynomial::zero(18);
            for (alpha, c) in exponents_of_degree(20).zip(&q.coefficients) {
                for axis in (0..3).filter(|&axis| alpha[axis] > 1) {
                    let mut lower = alpha;
                    lower[axis] -= 2;
                    let factor = (alpha[axis] * (alpha[axis] - 1)) as f64;
                    laplacian.coefficients[Polynomial::place(lower)] += factor * c;
                }
            }
            let norm = laplacian.squared_norm() / q.squared_norm();
            assert!(norm < 1e-20, "{norm}");
        }
    }

    /// The paper's e_n^j = 4 (n - j + 1)! (j + 1/2)! / ((n - j + 1/2)! j!), by its ratios.
    fn paper_coefficient(n: usize, j: usize) -> f64 {
        let rising = |a: f64, k: usize| -> f64 { (0..k).map(|i| a + i as f64).product() };
        4.0 * rising(1.0, n - j + 1) * rising(1.5, j) / (rising(1.5, n - j) * rising(1.0, j))
    }

    /// pi e_n^j sum_m Y Y = coefficient sum_m Q Q: both sides are multiples of the Legendre
    /// polynomial, so that one point decides. x = y on the sphere: sum_m Y Y = (2l + 1) / (4 pi).
    #[test]
    fn coefficients_are_those_of_the_paper() {
        let harmonics = Harmonics::new(20);
        let x: [f64; 3] = [0.36, -0.48, 0.8];
        let q = |a: usize| -> f64 {
            let n = harmonics.orders[a].0;
            let powers =
                exponents_of_degree(n).map(|alpha| (0..3).map(|i| x[i].powi(alpha[i] as i32)).product::<f64>());
            let values: Vec<f64> = powers.collect();
            let start = degree_range(n).start;
            harmonics.forward.row(a).iter().map(|&(place, c)| c * values[place - start]).sum()
        };
        for n in 0..=20 {
            for j in 0..=n / 2 {
                let same = degree_range(n).filter(|&a| harmonics.orders[a] == (n, j));
                let sum: f64 = same.map(|a| harmonics.coefficient(a) * q(a) * q(a)).sum();
                let expected = paper_coefficient(n, j) * (2 * (n - 2 * j) + 1) as f64 / 4.0;
                assert!((sum / expected - 1.0).abs() < 1e-12, "{n} {j} {sum} {expected}");
            }
        }
    }
}
