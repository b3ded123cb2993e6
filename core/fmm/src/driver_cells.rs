// SPDX-License-Identifier: GPL-3.0-or-later
//! Occlusion by the paper's own algorithm in the fast multipole method; the caller traces the rays.

use crate::cells::Cells;
use crate::driver::{Fmm, TARGETS_PER_SLAB};
use crate::driver_visibility::NearSeen;
use crate::error::Error;
use crate::near_field::NearField;
use crate::rays::Frame;
use crate::visibility::{Kind, Outcomes};
use crate::visible_lists::rows;
use rayon::prelude::*;
use std::sync::OnceLock;

impl Fmm {
    /// Makes pairs of cells of the octrees, whose rays are to be traced before `generate`.
    pub fn find_cells(&mut self, frame: Frame) -> Result<(), Error> {
        let cells = Cells::new(self.targets.clone(), self.sources.clone(), frame, self.lists.options)?;
        self.cells = Some(cells);
        Ok(())
    }

    /// The pairs of cells; none before `find_cells`.
    pub fn cells(&self) -> Option<&Cells> {
        self.cells.as_ref()
    }

    /// Reduces the lists to pairs of boxes whose cells see each other.
    pub fn generate(&mut self) {
        let Some(cells) = &self.cells else { return };
        let visible = cells.generate(&self.lists);
        let rows = |kind| rows(&self.targets, visible.valid.iter().filter(|pair| pair.kind == kind));
        self.lists.near_neighbours = rows(Kind::Near);
        self.lists.interaction_list = rows(Kind::Interaction);
        self.lists.local_interaction_list = rows(Kind::Local);
        self.lists.multipole_interaction_list = rows(Kind::Multipole);
        self.batches = self.lists.batches(&self.targets, &self.sources, TARGETS_PER_SLAB);
        self.translations = OnceLock::new();
        self.outcomes =
            Some(Outcomes { valid: visible.valid.len(), partial: visible.postponed, invalid: visible.invalid.len() });
    }

    /// As [`Fmm::near_seen`]: cells decide about near patches as about all others, and only what they do not tell is for
    /// rays.
    pub(crate) fn near_seen_by_cells(&self, cells: &Cells, near: &NearField, points_per_patch: usize) -> NearSeen {
        let row = |target: usize| {
            let i = self.targets.to_tree[target] as usize;
            let patches = &near.patches[near.starts[target]..near.starts[target + 1]];
            let sources =
                patches.iter().flat_map(|&q| (0..points_per_patch).map(move |k| q as usize * points_per_patch + k));
            sources.map(|source| cells.sees(i, self.sources.to_tree[source] as usize)).collect()
        };
        let rows: Vec<Vec<Option<bool>>> = (0..self.targets.n_points()).into_par_iter().map(row).collect();
        let seen = rows.concat();
        NearSeen {
            counted: seen.iter().map(|seen| seen.unwrap_or(false)).collect(),
            known: seen.iter().map(Option::is_some).collect(),
        }
    }
}
