// SPDX-License-Identifier: GPL-3.0-or-later
//! Random particles, the direct sum, and chains of operators with their errors against it.

use fmm::expansion::Expansion;
use std::f64::consts::PI;

/// Particles in the coordinates of their own box.
#[derive(Clone, Debug)]
pub struct Particles {
    pub positions: Vec<[f64; 3]>,
    pub normals: Vec<[f64; 3]>,
    pub strengths: Vec<[f64; 3]>,
}

/// A small generator of numbers in [-1, 1), so that every run sees the same particles.
struct Random(u64);

impl Random {
    fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> [f64; 3] {
        std::array::from_fn(|_| self.number())
    }

    fn unit(&mut self) -> [f64; 3] {
        let v = self.vector();
        let length = dot(v, v).sqrt().max(1e-3);
        v.map(|x| x / length)
    }
}

pub fn particles(count: usize, seed: u64) -> Particles {
    let mut random = Random(seed);
    Particles {
        positions: (0..count).map(|_| random.vector()).collect(),
        normals: (0..count).map(|_| random.unit()).collect(),
        strengths: (0..count).map(|_| random.vector()).collect(),
    }
}

pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Particles {
    /// The same particles seen from a centre at -shift, in units scale times as large.
    pub fn seen(&self, scale: f64, shift: [f64; 3]) -> Self {
        let place = |y: &[f64; 3]| std::array::from_fn(|i| (y[i] + shift[i]) / scale);
        Self { positions: self.positions.iter().map(place).collect(), ..self.clone() }
    }
}

/// H(x) = sum_y q K(x, y), with the sources displaced by `shift`.
pub fn direct(targets: &Particles, sources: &Particles, shift: [f64; 3]) -> Vec<[f64; 3]> {
    let kernel = |x: &[f64; 3], n_x: &[f64; 3], y: &[f64; 3], n_y: &[f64; 3]| {
        let d: [f64; 3] = std::array::from_fn(|i| x[i] - y[i] - shift[i]);
        -dot(*n_y, d) * dot(*n_x, d) / (PI * dot(d, d).powi(2))
    };
    let receivers = targets.positions.iter().zip(&targets.normals);
    let irradiance = |(x, n_x): (&[f64; 3], &[f64; 3])| {
        let mut h = [0.0; 3];
        for (k, y) in sources.positions.iter().enumerate() {
            let value = kernel(x, n_x, y, &sources.normals[k]);
            (0..3).for_each(|c| h[c] += value * sources.strengths[k][c]);
        }
        h
    };
    receivers.map(irradiance).collect()
}

/// Relative L2 error.
pub fn error(found: &[[f64; 3]], expected: &[[f64; 3]]) -> f64 {
    let pairs = found.as_flattened().iter().zip(expected.as_flattened());
    let (error, norm) = pairs.fold((0.0, 0.0), |(e, n), (a, b)| (e + (a - b).powi(2), n + b.powi(2)));
    (error / norm).sqrt()
}

pub fn zeros(len: usize) -> Vec<[f64; 3]> {
    vec![[0.0; 3]; len]
}

pub fn multipole(expansion: &dyn Expansion, sources: &Particles) -> Vec<[f64; 3]> {
    let mut m = zeros(expansion.multipole_len());
    expansion.p2m(&sources.positions, &sources.normals, &sources.strengths, &mut m);
    m
}

pub fn local_at(expansion: &dyn Expansion, local: &[[f64; 3]], targets: &Particles) -> Vec<[f64; 3]> {
    let mut h = vec![[0.0; 3]; targets.positions.len()];
    expansion.l2p(local, &targets.positions, &targets.normals, &mut h);
    h
}

/// Centre of child `octant` in its parent, seen from the child, times -1: y_parent = (y + o) / 2.
pub fn corner(octant: usize) -> [f64; 3] {
    std::array::from_fn(|axis| if octant >> axis & 1 == 1 { 1.0 } else { -1.0 })
}

pub fn shift(offset: [i32; 3]) -> [f64; 3] {
    offset.map(|o| 2.0 * f64::from(o))
}

/// p2m, then evaluation at receivers in a box `offset` away.
pub fn p2m2p(expansion: &dyn Expansion, offset: [i32; 3]) -> f64 {
    let (sources, targets) = (particles(50, 1), particles(40, 2));
    let seen = targets.seen(1.0, shift(offset.map(|o| -o)));
    let mut h = vec![[0.0; 3]; 40];
    let m = multipole(expansion, &sources);
    expansion.m2p(&m, &seen.positions, &seen.normals, &mut h);
    error(&h, &direct(&targets, &sources, shift(offset)))
}

/// The same with the sources in a child, moved to the parent, whose offset is given.
pub fn p2m2m2p(expansion: &dyn Expansion, octant: usize, offset: [i32; 3]) -> f64 {
    let (sources, targets) = (particles(50, 3), particles(40, 4));
    let mut m = zeros(expansion.multipole_len());
    expansion.m2m(octant, &multipole(expansion, &sources), &mut m);
    let seen = targets.seen(1.0, shift(offset.map(|o| -o)));
    let mut h = vec![[0.0; 3]; 40];
    expansion.m2p(&m, &seen.positions, &seen.normals, &mut h);
    let sources = sources.seen(2.0, corner(octant));
    error(&h, &direct(&targets, &sources, shift(offset)))
}

/// One translation between boxes of one size.
pub fn p2m2l2p(expansion: &dyn Expansion, offset: [i32; 3]) -> f64 {
    let (sources, targets) = (particles(50, 5), particles(40, 6));
    let mut local = zeros(expansion.local_len());
    let operator = expansion.m2l_operator(offset);
    operator.apply(3, multipole(expansion, &sources).as_flattened(), local.as_flattened_mut());
    let h = local_at(expansion, &local, &targets);
    error(&h, &direct(&targets, &sources, shift(offset)))
}

/// Child to parent, across, and parent to child: every translation once.
pub fn p2m2m2l2l2p(expansion: &dyn Expansion, octants: [usize; 2], offset: [i32; 3]) -> f64 {
    let (sources, targets) = (particles(50, 7), particles(40, 8));
    let mut m = zeros(expansion.multipole_len());
    expansion.m2m(octants[0], &multipole(expansion, &sources), &mut m);
    let (mut parent, mut child) = (zeros(expansion.local_len()), zeros(expansion.local_len()));
    expansion.m2l_operator(offset).apply(3, m.as_flattened(), parent.as_flattened_mut());
    expansion.l2l(octants[1], &parent, &mut child);
    let h = local_at(expansion, &child, &targets);
    let sources = sources.seen(2.0, corner(octants[0]));
    let targets = targets.seen(2.0, corner(octants[1]));
    error(&h, &direct(&targets, &sources, shift(offset)))
}

pub fn p2l2p(expansion: &dyn Expansion, offset: [i32; 3]) -> f64 {
    let (sources, targets) = (particles(50, 9), particles(40, 10));
    let seen = sources.seen(1.0, shift(offset));
    let mut local = zeros(expansion.local_len());
    expansion.p2l(&seen.positions, &seen.normals, &seen.strengths, &mut local);
    error(&local_at(expansion, &local, &targets), &direct(&targets, &sources, shift(offset)))
}
