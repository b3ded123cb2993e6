// SPDX-License-Identifier: GPL-3.0-or-later
//! Gauss-Legendre points of a box.

/// Nodes and weights on [-1, 1], exact for polynomials of degree 2 count - 1; nodes ascend.
pub fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    (0..count).rev().map(|k| newton(count, k)).collect()
}

/// Root k of the Legendre polynomial of degree `count`, from Tricomi's first guess.
fn newton(count: usize, k: usize) -> (f64, f64) {
    let mut x = (std::f64::consts::PI * (k as f64 + 0.75) / (count as f64 + 0.5)).cos();
    for _ in 0..20 {
        let (value, slope) = legendre(count, x);
        x -= value / slope;
    }
    let (_, slope) = legendre(count, x);
    (x, 2.0 / ((1.0 - x * x) * slope * slope))
}

/// P_n(x) and its derivative.
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut previous, mut value) = (0.0, 1.0);
    for k in 0..n {
        let k = k as f64;
        (previous, value) = (value, ((2.0 * k + 1.0) * x * value - k * previous) / (k + 1.0));
    }
    (value, n as f64 * (x * value - previous) / (x * x - 1.0))
}

/// A node of the product rule in the box [-1, 1]^3.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    pub position: [f64; 3],
    pub weight: f64,
}

/// The product rule with `count` nodes an axis, the last axis fastest.
pub fn box_rule(count: usize) -> Vec<Node> {
    let rule = gauss_legendre(count);
    let mut nodes = Vec::with_capacity(count.pow(3));
    for &(x, u) in &rule {
        for &(y, v) in &rule {
            nodes.extend(rule.iter().map(|&(z, w)| Node { position: [x, y, z], weight: u * v * w }));
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrates_powers_exactly() {
        for count in 1..=12 {
            for power in 0..2 * count as i32 {
                let sum: f64 = gauss_legendre(count).iter().map(|(x, w)| w * x.powi(power)).sum();
                let exact = if power % 2 == 0 { 2.0 / f64::from(power + 1) } else { 0.0 };
                assert!((sum - exact).abs() < 1e-14, "{count} {power} {sum}");
            }
        }
        assert_eq!(box_rule(3).len(), 27);
        assert!((box_rule(3).iter().map(|node| node.weight).sum::<f64>() - 8.0).abs() < 1e-13);
    }
}
