// SPDX-License-Identifier: GPL-3.0-or-later
//! The fast multipole method, step by step as in section 4 of the paper.

use crate::cells::Cells;
use crate::direct::Sources;
use crate::driver_visibility::Rounds;
use crate::error::{Error, same_length};
use crate::expansion::{Expansion, InColours};
use crate::gather::Gather;
use crate::links::Links;
use crate::lists::{Batches, Lists, ListsOptions};
use crate::medium::Medium;
use crate::moving::Moved;
use crate::octree::Octree;
use crate::passes::Passes;
use crate::shaft::Blockers;
use crate::translations::Translations;
use crate::visibility::Outcomes;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// Target boxes whose interaction lists one thread takes together: enough pairs of one offset for a matrix product.
pub(crate) const TARGETS_PER_SLAB: usize = 2048;

/// The cosine that may pass for one at the horizon at truncation p. It costs about its square of the irradiance, which
/// this keeps at about a quarter of what the truncation itself costs.
pub fn grazing(truncation: usize) -> f64 {
    0.16 * 0.61_f64.powi(truncation.min(20) as i32)
}

/// Pairs of points that are summed directly in the time that one multipole-to-local translation takes: leaves with fewer
/// are near neighbours wherever they are, which is exact, too. Both rates are those of a core with AVX-512.
pub fn direct_pairs(multipole_len: usize) -> usize {
    multipole_len * multipole_len / 10
}

/// Points that one point is summed with directly in the time that its own expansion about another box takes (p2l, m2p).
pub fn direct_points(multipole_len: usize) -> usize {
    multipole_len * multipole_len / 15
}

/// Everything that does not depend on the strengths: step 1, "Setup".
pub struct Fmm {
    pub(crate) expansion: Arc<dyn Expansion>,
    pub(crate) targets: Arc<Octree>,
    pub(crate) sources: Arc<Octree>,
    pub(crate) lists: Lists,
    pub(crate) batches: Batches,
    pub(crate) translations: OnceLock<Translations>,
    separation: u32,
    points: Sources,
    pub(crate) softening: Vec<f64>,
    pub(crate) links: Links,
    pub(crate) gather: Gather,
    pub(crate) blockers: Blockers,
    pub(crate) medium: Medium,
    pub(crate) rounds: Option<Rounds>,
    pub(crate) cells: Option<Cells>,
    pub(crate) moved: Moved,
    /// Of the pairs of cells.
    pub(crate) outcomes: Option<Outcomes>,
}

/// Seconds of each pass of one application, in the order in which they ran.
pub type Seconds = Vec<(&'static str, f64)>;

impl Fmm {
    /// Lists and translations of two octrees on one grid; `softening` (N,) as in [`Sources::new`], scene order.
    pub fn new(
        expansion: Arc<dyn Expansion>,
        targets: impl Into<Arc<Octree>>,
        sources: impl Into<Arc<Octree>>,
        softening: &[f64],
        options: ListsOptions,
    ) -> Result<Self, Error> {
        Self::among(expansion, targets, sources, softening, options, (&[], &Medium::default()))
    }

    /// The same among triangles (T, 3, 3) in a medium. Where any of them can be between points of the octrees, or the medium
    /// absorbs anything, the lists stay empty, for [`Fmm::occlude`] to make.
    pub fn among(
        expansion: Arc<dyn Expansion>,
        targets: impl Into<Arc<Octree>>,
        sources: impl Into<Arc<Octree>>,
        softening: &[f64],
        options: ListsOptions,
        (triangles, medium): (&[[[f64; 3]; 3]], &Medium),
    ) -> Result<Self, Error> {
        let (targets, sources) = (targets.into(), sources.into());
        same_length("source softening", sources.n_points(), softening.len())?;
        let blockers = Blockers::new(triangles, [&targets, &sources]);
        let lists = if blockers.is_empty() && medium.is_clear() {
            Lists::new(&targets, &sources, options)?
        } else {
            Lists::empty(&targets, options)
        };
        let batches = lists.batches(&targets, &sources, TARGETS_PER_SLAB);
        let softening: Vec<f64> = sources.to_scene.iter().map(|&j| softening[j as usize]).collect();
        let leaves = sources.points_of_leaves();
        let points = Sources::grouped(&sources.positions, &sources.normals, &softening, leaves)?;
        Ok(Self {
            expansion,
            targets,
            sources,
            lists,
            batches,
            translations: OnceLock::new(),
            separation: options.separation,
            points,
            softening,
            links: Links::default(),
            gather: Gather::default(),
            blockers,
            medium: medium.clone(),
            rounds: None,
            cells: None,
            moved: Moved::default(),
            outcomes: None,
        })
    }

    /// Irradiance (M, C) at the targets from sources of strengths q = weight * radiosity (N, C) in C colours, both in scene order.
    pub fn apply<const C: usize>(&self, strengths: &[[f64; C]]) -> Result<Vec<[f64; C]>, Error>
    where
        dyn Expansion: InColours<C>,
    {
        Ok(self.apply_timed(strengths)?.0)
    }

    /// As [`Fmm::apply`], with the seconds of each pass.
    pub fn apply_timed<const C: usize>(&self, strengths: &[[f64; C]]) -> Result<(Vec<[f64; C]>, Seconds), Error>
    where
        dyn Expansion: InColours<C>,
    {
        self.apply_through(strengths, false)
    }

    /// The same; `clear` as if nothing were absorbed.
    pub fn apply_through<const C: usize>(
        &self,
        strengths: &[[f64; C]],
        clear: bool,
    ) -> Result<(Vec<[f64; C]>, Seconds), Error>
    where
        dyn Expansion: InColours<C>,
    {
        let count = self.sources.n_points();
        same_length("strengths", count + self.moved.guests, strengths.len())?;
        let (own, guests) = strengths.split_at(count);
        let mut q = self.sources.in_tree_order(own);
        q.extend(guests);
        let passes = Passes {
            expansion: self.expansion.as_ref(),
            targets: &self.targets,
            sources: &self.sources,
            lists: &self.lists,
            batches: &self.batches,
            translations: self.translations(),
            points: &self.points,
            links: &self.links,
            gather: &self.gather,
            medium: (!clear && !self.medium.is_clear()).then_some(&self.medium),
        };
        let (irradiance, seconds) = run(&passes, &q)?;
        Ok((self.targets.in_scene_order(&irradiance), seconds))
    }

    /// The operators, made at the first application: counting work needs none.
    pub(crate) fn translations(&self) -> &Translations {
        let make = || Translations::new(self.expansion.as_ref(), &self.batches, self.separation);
        self.translations.get_or_init(make)
    }

    /// How much there is of everything that costs time: boxes, pairs of the lists, point pairs of the near neighbours.
    pub fn counts(&self) -> [(&'static str, usize); 14] {
        let [u, v, x, w] = self.lists.all();
        let points = |tree: &Octree, b: u32| tree.count(b as usize);
        let near = |(t, s): (usize, usize)| self.targets.count(t) * self.sources.count(s);
        [
            ("boxes", self.targets.n_boxes()),
            ("leaves", self.targets.leaves().count()),
            ("coefficients", self.expansion.multipole_len()),
            ("near_pairs", u.boxes.len()),
            ("point_pairs", u.pairs().map(near).sum()),
            ("interactions", v.boxes.len()),
            ("batches", self.batches.batches.len()),
            ("p2l_pairs", x.boxes.len()),
            ("p2l_points", x.boxes.iter().map(|&s| points(&self.sources, s)).sum()),
            ("m2p_pairs", w.boxes.len()),
            ("m2p_points", w.pairs().map(|(t, _)| self.targets.count(t)).sum()),
            ("links", self.links.count(&self.targets)),
            ("hits", self.gather.count()),
            ("postponed", self.lists.facing_counts.postponed as usize),
        ]
    }

    /// The octree of the receivers.
    pub fn targets(&self) -> &Octree {
        &self.targets
    }

    /// The octree of the sources.
    pub fn sources(&self) -> &Octree {
        &self.sources
    }

    /// The interaction lists.
    pub fn lists(&self) -> &Lists {
        &self.lists
    }

    /// The expansion in use.
    pub fn expansion(&self) -> &dyn Expansion {
        self.expansion.as_ref()
    }
}

/// Irradiance (M, C) from strengths (N, C), tree order, which those of guests follow, and the seconds of each pass.
pub(crate) fn run<const C: usize>(passes: &Passes<C>, q: &[[f64; C]]) -> Result<(Vec<[f64; C]>, Seconds), Error>
where
    dyn Expansion: InColours<C>,
{
    let mut clock = Clock::default();
    let mut multipoles = passes.zero_multipoles()?;
    let mut locals = passes.zero_locals()?;
    let mut irradiance = vec![[0.0; C]; passes.targets.n_points()];
    let (all, q) = (q, &q[..passes.sources.n_points()]);

    // Step 2, multipole coefficients.
    clock.time("p2m", || passes.p2m(q, &mut multipoles));
    clock.time("m2m", || passes.m2m(&mut multipoles));
    // Step 3, downward pass.
    clock.time("m2l", || passes.m2l(&multipoles, &mut locals));
    clock.time("p2l", || passes.p2l(q, &mut locals));
    clock.time("l2l", || passes.l2l(&mut locals));
    // Step 4, evaluation.
    clock.time("l2p", || passes.l2p(&locals, &mut irradiance));
    clock.time("m2p", || passes.m2p(&multipoles, &mut irradiance));
    clock.time("p2p", || passes.p2p(q, &mut irradiance));
    clock.time("links", || passes.links(q, &mut irradiance));
    clock.time("gather", || passes.gather(all, &mut irradiance));

    Ok((irradiance, clock.seconds))
}

#[derive(Default)]
struct Clock {
    seconds: Seconds,
}

impl Clock {
    fn time(&mut self, pass: &'static str, work: impl FnOnce()) {
        let start = Instant::now();
        work();
        self.seconds.push((pass, start.elapsed().as_secs_f64()));
    }
}
