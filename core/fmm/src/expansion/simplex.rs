// SPDX-License-Identifier: GPL-3.0-or-later
//! The monomials x^a y^b z^c of degree at most p, in one fixed order.

/// Number of monomials in three variables of degree at most `degree`: C(degree + 3, 3).
pub const fn monomials(degree: usize) -> usize {
    (degree + 1) * (degree + 2) * (degree + 3) / 6
}

/// An exponent vector alpha = (a, b, c).
pub type Exponent = [usize; 3];

/// |alpha|, the degree of a monomial.
pub const fn degree(alpha: Exponent) -> usize {
    alpha[0] + alpha[1] + alpha[2]
}

/// alpha + e_axis.
pub fn raised(alpha: Exponent, axis: usize) -> Exponent {
    let mut raised = alpha;
    raised[axis] += 1;
    raised
}

/// alpha - e_axis, if there is one.
pub fn lowered(alpha: Exponent, axis: usize) -> Option<Exponent> {
    let mut lowered = alpha;
    lowered[axis] = alpha[axis].checked_sub(1)?;
    Some(lowered)
}

/// Place of a monomial in the order: by degree, then a downwards, then b downwards.
///
/// Every degree is one contiguous run, and the order for a smaller p is a prefix of this one.
pub const fn index(alpha: Exponent) -> usize {
    let n = degree(alpha);
    let m = alpha[1] + alpha[2];
    n * (n + 1) * (n + 2) / 6 + m * (m + 1) / 2 + alpha[2]
}

/// The exponents of degree at most `p`, in the order of [`index`].
pub fn exponents(p: usize) -> Vec<Exponent> {
    (0..=p).flat_map(exponents_of_degree).collect()
}

/// The exponents of degree exactly `n`, in the order of [`index`].
pub fn exponents_of_degree(n: usize) -> impl Iterator<Item = Exponent> {
    (0..=n).flat_map(move |m| (0..=m).map(move |c| [n - m, m - c, c]))
}

/// n! / (a! b! c!) with n = |alpha|.
pub fn multinomial(alpha: Exponent) -> f64 {
    binomial(degree(alpha), alpha[0]) * binomial(alpha[1] + alpha[2], alpha[1])
}

/// The binomial coefficient C(n, k).
pub fn binomial(n: usize, k: usize) -> f64 {
    (0..k.min(n - k)).fold(1.0, |product, i| product * (n - i) as f64 / (i + 1) as f64)
}

/// The binomials C(n, k) for n up to a limit, for loops that need them often.
#[derive(Clone, Debug)]
pub struct Pascal {
    side: usize,
    table: Vec<f64>,
}

impl Pascal {
    pub fn new(limit: usize) -> Self {
        let side = limit + 1;
        let entry = |n, k| if k <= n { binomial(n, k) } else { 0.0 };
        Self { side, table: (0..side * side).map(|i| entry(i / side, i % side)).collect() }
    }

    /// (alpha + beta)! / (alpha! beta!): the factor between D^(alpha + beta) / (alpha + beta)! and
    /// the term in x^beta y^alpha of a series in x + y.
    pub fn ways(&self, alpha: Exponent, beta: Exponent) -> f64 {
        let one = |axis: usize| self.table[(alpha[axis] + beta[axis]) * self.side + alpha[axis]];
        one(0) * one(1) * one(2)
    }
}

/// alpha + beta.
pub fn sum(alpha: Exponent, beta: Exponent) -> Exponent {
    std::array::from_fn(|axis| alpha[axis] + beta[axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_matches_index() {
        for (place, alpha) in exponents(20).into_iter().enumerate() {
            assert_eq!(index(alpha), place);
        }
        assert_eq!(exponents(20).len(), monomials(20));
    }

    #[test]
    fn multinomials_sum_to_powers_of_three() {
        for n in 0..=20 {
            let sum: f64 = exponents_of_degree(n).map(multinomial).sum();
            assert!((sum / 3f64.powi(n as i32) - 1.0).abs() < 1e-14);
        }
    }
}
