// SPDX-License-Identifier: GPL-3.0-or-later
#![allow(clippy::expect_used, clippy::unwrap_used)]
//! Operator chains of both expansions against the direct sum.

mod chains;

use chains::{
    Particles, corner, direct, dot, error, local_at, multipole, p2l2p, p2m2l2p, p2m2m2l2l2p, p2m2m2p, p2m2p, particles,
    shift, zeros,
};
use fmm::expansion::{Compressed, Expansion, InColours, Paper, Whole, error_bound, reflect};
use proptest::prelude::*;

type Maker = fn(usize) -> Box<dyn Expansion>;

/// The expansions whose only error is their truncation.
const EXPANSIONS: [(&str, Maker); 2] = [("paper", |p| Box::new(Paper::new(p))), ("whole", |p| Box::new(Whole::new(p)))];

fn all_expansions(p: usize) -> [Box<dyn Expansion>; 3] {
    [Box::new(Paper::new(p)), Box::new(Whole::new(p)), Box::new(Compressed::new(p, 1))]
}

type Chain = fn(&dyn Expansion, [i32; 3]) -> f64;

/// Chains with one expansion about one centre, and the offsets they are tried at.
const ONE_CENTRE: [(&str, Chain); 3] =
    [("p2m2p", p2m2p), ("p2m2m2p", |e, offset| p2m2m2p(e, 5, offset)), ("p2l2p", p2l2p)];

/// Chains with a translation between two centres.
const TWO_CENTRES: [(&str, Chain); 2] =
    [("p2m2l2p", p2m2l2p), ("p2m2m2l2l2p", |e, offset| p2m2m2l2l2p(e, [3, 6], offset))];

const OFFSETS: [[i32; 3]; 5] = [[2, 0, 0], [2, 1, 1], [-3, 1, 2], [0, 6, 0], [7, -5, 2]];

/// Below this only rounding is left.
const ROUNDING: f64 = 3e-13;

/// Greatest |y| / |x| of a source and a receiver: corners of the boxes, for one expansion, and
/// of an expansion between two centres, where |x| is as near as the corner of the other box.
fn ratio(offset: [i32; 3], centres: usize) -> f64 {
    let distance = shift(offset).map(|x| x * x).iter().sum::<f64>().sqrt();
    match centres {
        1 => 3f64.sqrt() / nearest(offset),
        _ => 3f64.sqrt() / (distance - 3f64.sqrt()),
    }
}

/// Distance of the centre of one box from the nearest point of the other.
fn nearest(offset: [i32; 3]) -> f64 {
    shift(offset).map(|x| (x.abs() - 1.0).max(0.0).powi(2)).iter().sum::<f64>().sqrt()
}

/// C(p + 3, 3), by which the terms of (eq 4) grow beside the powers of the ratio.
fn growth(p: usize) -> f64 {
    ((p + 1) * (p + 2) * (p + 3)) as f64 / 6.0
}

/// Between p = 4 and any greater p the error falls at least as fast as C(p + 3, 3) ratio^p.
fn assert_rate(chains: &[(&str, Chain)], centres: usize) {
    for (name, make) in EXPANSIONS {
        let start = make(4);
        for p in [8, 12, 16, 20] {
            let expansion = make(p);
            for (chain, run) in chains {
                for offset in OFFSETS {
                    let promised = ratio(offset, centres).powi(p as i32 - 4) * growth(p) / growth(4);
                    let limit = run(&*start, offset) * promised + ROUNDING;
                    let error = run(&*expansion, offset);
                    assert!(error <= limit, "{name} {chain} p={p} {offset:?}: {error} > {limit}");
                }
            }
        }
    }
}

#[test]
fn errors_about_one_centre_fall_as_promised() {
    assert_rate(&ONE_CENTRE, 1);
}

#[test]
fn errors_between_two_centres_fall_as_promised() {
    assert_rate(&TWO_CENTRES, 2);
}

#[test]
fn errors_reach_the_precision_limit() {
    for (name, make) in EXPANSIONS {
        let expansion = make(20);
        for (chain, run) in ONE_CENTRE.iter().chain(&TWO_CENTRES) {
            let near = run(&*expansion, OFFSETS[0]);
            assert!(near < 5e-6, "{name} {chain}: {near}");
            for offset in &OFFSETS[2..] {
                let error = run(&*expansion, *offset);
                assert!(error < 1e-12, "{name} {chain} {offset:?}: {error}");
            }
        }
    }
}

/// The whole kernel needs fewer coefficients than the paper's expansion at every p.
#[test]
fn coefficients_are_as_many_as_derived() {
    for p in 0..=12 {
        let monomials = (p + 1) * (p + 2) * (p + 3) / 6;
        let whole: usize = (0..=p).map(|n| (n + 1) * (n + 3)).sum();
        assert_eq!(Paper::new(p).multipole_len(), 16 * monomials);
        assert_eq!(Whole::new(p).multipole_len(), whole);
        assert_eq!(whole, 3 * monomials - p * (p + 1) * (p + 2) / 6);
    }
}

#[test]
fn m2m_is_exact() {
    for (name, make) in EXPANSIONS {
        for p in [0, 1, 2, 5, 20] {
            let expansion = make(p);
            for octant in 0..8 {
                let child = particles(30, 11 + octant as u64);
                let mut moved = zeros(expansion.multipole_len());
                expansion.m2m(octant, &multipole(&*expansion, &child), &mut moved);
                let parent = multipole(&*expansion, &child.seen(2.0, corner(octant)));
                let error = error(&moved, &parent);
                assert!(error < 1e-13, "{name} p={p} octant {octant}: {error}");
            }
        }
    }
}

#[test]
fn l2l_is_exact() {
    for (name, make) in EXPANSIONS {
        for p in [0, 1, 2, 5, 20] {
            let expansion = make(p);
            let parent = particles(expansion.local_len(), 21).positions;
            for octant in 0..8 {
                let targets = particles(30, 31 + octant as u64);
                let mut child = zeros(expansion.local_len());
                expansion.l2l(octant, &parent, &mut child);
                let found = local_at(&*expansion, &child, &targets);
                let seen = targets.seen(2.0, corner(octant));
                let error = error(&found, &local_at(&*expansion, &parent, &seen));
                assert!(error < 1e-13, "{name} p={p} octant {octant}: {error}");
            }
        }
    }
}

/// All of a source at the centre is in the term n = 0, so that its translation (eq 11) has to
/// give the local coefficients of that very source (eq 10), at any p.
#[test]
fn m2l_of_a_source_at_the_centre_is_p2l() {
    for (name, make) in EXPANSIONS {
        for p in [0, 1, 3, 6, 12] {
            let expansion = make(p);
            for offset in OFFSETS {
                let source = Particles { positions: vec![[0.0; 3]], ..particles(1, 41) };
                let mut translated = zeros(expansion.local_len());
                let operator = expansion.m2l_operator(offset);
                let multipole = multipole(&*expansion, &source);
                operator.apply(3, multipole.as_flattened(), translated.as_flattened_mut());
                let seen = source.seen(1.0, shift(offset));
                let mut local = zeros(expansion.local_len());
                expansion.p2l(&seen.positions, &seen.normals, &seen.strengths, &mut local);
                let error = error(&translated, &local);
                assert!(error < 1e-12, "{name} p={p} {offset:?}: {error}");
            }
        }
    }
}

/// Modes give up exactness between levels, but nothing that their truncation could resolve.
#[test]
fn compressed_is_smaller_and_as_accurate() {
    for p in 0..=6 {
        let (compressed, whole) = (Compressed::new(p, 1), Whole::new(p));
        assert_eq!(compressed.truncation(), p);
        assert!(compressed.multipole_len() <= whole.multipole_len());
        let nearest = p2m2l2p(&whole, [2, 0, 0]);
        for (chain, run) in ONE_CENTRE.iter().chain(&TWO_CENTRES) {
            for offset in [[2, 0, 0], [2, 1, 1], [-3, 1, 2], [0, 3, -3]] {
                let error = run(&compressed, offset);
                let limit = 1.5 * run(&whole, offset) + 0.15 * nearest;
                assert!(error <= limit, "{chain} p={p} {offset:?}: {error} > {limit}");
            }
        }
    }
    assert!(3 * Compressed::new(6, 1).multipole_len() < 2 * Whole::new(6).multipole_len());
    assert!(p2m2l2p(&Compressed::new(4, 2), [3, 0, 0]) < 1e-2);
}

#[test]
fn no_particles_add_nothing() {
    for expansion in all_expansions(2) {
        let mut coefficients = vec![[1.0; 3]; expansion.multipole_len()];
        expansion.p2m(&[], &[], &[], &mut coefficients);
        expansion.p2l(&[], &[], &[], &mut coefficients);
        assert!(coefficients.as_flattened().iter().all(|&x| x == 1.0));
        expansion.l2p(&coefficients, &[], &[], &mut []);
        expansion.m2p(&coefficients, &[], &[], &mut []);
    }
}

/// Mirrors a box: positions, normals and thus everything else.
fn mirrored(particles: &Particles, mask: u8) -> Particles {
    let mirror = |v: &[f64; 3]| std::array::from_fn(|i| if mask >> i & 1 == 1 { -v[i] } else { v[i] });
    Particles {
        positions: particles.positions.iter().map(mirror).collect(),
        normals: particles.normals.iter().map(mirror).collect(),
        strengths: particles.strengths.clone(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn reflections_follow_the_parities(mask in 0u8..8, seed in 1u64..1000, p in 0usize..4) {
        for expansion in all_expansions(p) {
            let sources = particles(5, seed);
            let mut reflected = multipole(&*expansion, &sources);
            reflect(expansion.parities(), mask, 3, reflected.as_flattened_mut());
            let m = multipole(&*expansion, &mirrored(&sources, mask));
            prop_assert!(error(&m, &reflected) < 1e-12);

            let offset = [3, 1, -2];
            let there = std::array::from_fn(|i| if mask >> i & 1 == 1 { -offset[i] } else { offset[i] });
            let [mut here, mut mirror] = [(); 2].map(|()| zeros(expansion.local_len()));
            expansion.m2l_operator(offset).apply(3, reflected.as_flattened(), here.as_flattened_mut());
            reflect(expansion.parities(), mask, 3, here.as_flattened_mut());
            let back = multipole(&*expansion, &sources);
            expansion.m2l_operator(there).apply(3, back.as_flattened(), mirror.as_flattened_mut());
            prop_assert!(error(&here, &mirror) < 1e-10);
        }
    }

    #[test]
    fn operators_add_to_their_output(seed in 1u64..1000, p in 0usize..4, octant in 0usize..8) {
        for expansion in all_expansions(p) {
            let sources = particles(7, seed);
            let once = multipole(&*expansion, &sources);
            let mut twice = once.clone();
            expansion.p2m(&sources.positions, &sources.normals, &sources.strengths, &mut twice);
            let double: Vec<_> = once.iter().map(|x| x.map(|x| 2.0 * x)).collect();
            prop_assert!(error(&twice, &double) < 1e-14);

            let (mut up, mut sum) = (zeros(once.len()), once.clone());
            expansion.m2m(octant, &once, &mut up);
            expansion.m2m(octant, &once, &mut sum);
            let expected: Vec<[f64; 3]> =
                up.iter().zip(&once).map(|(a, b)| std::array::from_fn(|c| a[c] + b[c])).collect();
            prop_assert!(error(&sum, &expected) < 1e-14);
        }
    }

    /// The bound of section 2.2 holds for every receiver outside the sources, at every p.
    #[test]
    fn real_errors_stay_below_the_bound(
        seed in 1u64..10_000, p in 0usize..14, distance in 1.05f64..8.0, spread in 0.05f64..1.0,
    ) {
        let paper = Paper::new(p);
        let mut sources = particles(6, seed);
        sources.positions.iter_mut().flatten().for_each(|x| *x *= spread);
        let length = |v: &[f64; 3]| dot(*v, *v).sqrt();
        let r_y = sources.positions.iter().map(length).fold(0.0, f64::max);
        let r_x = distance * r_y;
        let mut receivers = particles(1, seed + 1);
        let scale = r_x / length(&receivers.positions[0]);
        receivers.positions[0] = receivers.positions[0].map(|x| x * scale);

        let mut h = [[0.0; 3]];
        let m = multipole(&paper, &sources);
        paper.m2p(&m, &receivers.positions, &receivers.normals, &mut h);
        let exact = direct(&receivers, &sources, [0.0; 3])[0];
        for c in 0..3 {
            let strength: f64 = sources.strengths.iter().map(|q| q[c].abs()).sum();
            let bound = error_bound(p, strength, r_y, r_x);
            let rounding = 1e-13 * error_bound(0, strength, r_y, r_x);
            let error = (h[0][c] - exact[c]).abs();
            prop_assert!(error <= bound + rounding, "p={p}: {error} > {bound}");
        }
    }
}
