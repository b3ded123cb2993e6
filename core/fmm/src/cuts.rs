// SPDX-License-Identifier: GPL-3.0-or-later
//! A triangle in its own plane, cut along lines into smaller ones.

pub(crate) type Point = [f64; 2];

pub(crate) fn distance(p: Point, q: Point) -> f64 {
    (p[0] - q[0]).hypot(p[1] - q[1])
}

/// How far a point is to the left of the line through two others.
pub(crate) fn left_of([p, q]: [Point; 2], x: Point) -> f64 {
    ((q[0] - p[0]) * (x[1] - p[1]) - (q[1] - p[1]) * (x[0] - p[0])) / distance(p, q)
}

pub(crate) fn between(p: Point, q: Point, t: f64) -> Point {
    [0, 1].map(|i| p[i] + t * (q[i] - p[i]))
}

/// What of a line lies more than `depth` inside a counter-clockwise triangle, if that is longer.
pub(crate) fn clip(line: [Point; 2], corners: &[Point; 3], depth: f64) -> Option<[Point; 2]> {
    clipped(line, corners, depth).filter(|part| distance(part[0], part[1]) > depth.abs())
}

/// The same however short it is.
pub(crate) fn clipped(line: [Point; 2], corners: &[Point; 3], depth: f64) -> Option<[Point; 2]> {
    let (mut start, mut end) = (0.0f64, 1.0f64);
    for i in 0..3 {
        let edge = [corners[i], corners[(i + 1) % 3]];
        if distance(edge[0], edge[1]) == 0.0 {
            return None;
        }
        let [p, q] = line.map(|x| left_of(edge, x) - depth);
        match (p >= 0.0, q >= 0.0) {
            (true, true) => {}
            (false, false) => return None,
            (false, true) => start = start.max(p / (p - q)),
            (true, false) => end = end.min(p / (p - q)),
        }
    }
    (start < end).then(|| [between(line[0], line[1], start), between(line[0], line[1], end)])
}

/// Lines, the longest first, with those that continue each other as one: the rim of a fine mesh is many.
pub(crate) fn merged(mut lines: Vec<[Point; 2]>, slack: f64) -> Vec<[Point; 2]> {
    let mut found: Vec<[Point; 2]> = Vec::new();
    while let Some(mut line) = lines.pop() {
        let next =
            |line, lines: &[_]| lines.iter().enumerate().find_map(|(k, &other)| Some((k, joined(line, other, slack)?)));
        while let Some((k, whole)) = next(line, &lines) {
            lines.swap_remove(k);
            line = whole;
        }
        found.push(line);
    }
    found
}

/// Two lines as one, if one goes straight on from an end of the other.
fn joined(line: [Point; 2], other: [Point; 2], slack: f64) -> Option<[Point; 2]> {
    let ends = [[0, 0], [0, 1], [1, 0], [1, 1]];
    let [i, j] = ends.into_iter().find(|&[i, j]| distance(line[i], other[j]) <= slack)?;
    let whole = [line[1 - i], other[1 - j]];
    let is_longer = distance(whole[0], whole[1]) > distance(line[0], line[1]).max(distance(other[0], other[1]));
    (is_longer && left_of(whole, line[i]).abs() <= slack).then_some(whole)
}

/// The tree of one triangle; children are later in the list than their parent.
#[derive(Default)]
pub(crate) struct Cuts {
    pub nodes: Vec<Node>,
}

pub(crate) struct Node {
    corners: [Point; 3],
    pub edge: i8,
    pub fraction: f64,
    /// 0 for none.
    pub parts: [u32; 2],
}

impl Cuts {
    /// Cuts a triangle along each line in turn; what is nearer than `slack` is on it.
    pub fn along(lines: &[[Point; 2]], corners: [Point; 3], slack: f64) -> Self {
        let mut cuts = Self::default();
        cuts.add(corners);
        for &line in lines {
            let mut open = vec![0];
            while let Some(n) = open.pop() {
                let node = &cuts.nodes[n];
                if clip(line, &node.corners, slack).is_none() {
                    continue;
                }
                match node.edge {
                    -1 => cuts.split(n, line, slack),
                    _ => open.extend(node.parts.map(|part| part as usize)),
                }
            }
        }
        cuts
    }

    fn add(&mut self, corners: [Point; 3]) -> u32 {
        self.nodes.push(Node { corners, edge: -1, fraction: 0.5, parts: [0; 2] });
        self.nodes.len() as u32 - 1
    }

    /// Cuts a leaf along a line that goes through its inside, into two parts or three.
    fn split(&mut self, n: usize, line: [Point; 2], slack: f64) {
        let corners = self.nodes[n].corners;
        let sides = corners.map(|x| left_of(line, x)).map(|side| if side.abs() <= slack { 0.0 } else { side });
        // From a corner on the line, or else from the one that is alone on its side.
        let first = (0..3).find(|&i| sides[i] == 0.0);
        let alone = (0..3).find(|&i| sides[i] * sides[(i + 1) % 3] < 0.0 && sides[i] * sides[(i + 2) % 3] < 0.0);
        if let Some(i) = first {
            let (b, c) = ((i + 1) % 3, (i + 2) % 3);
            if sides[b] * sides[c] < 0.0 {
                self.bisect(n, b, sides[b] / (sides[b] - sides[c]));
            }
        } else if let Some(i) = alone {
            let (b, c) = ((i + 1) % 3, (i + 2) % 3);
            let half = self.bisect(n, i, sides[i] / (sides[i] - sides[b]));
            // The half is (a, m, c), to be cut on the way from c to a.
            self.bisect(half, 2, sides[c] / (sides[c] - sides[i]));
        }
    }

    /// Cuts a leaf from a place on the edge that starts at a corner to the opposite corner; returns the first half.
    fn bisect(&mut self, n: usize, edge: usize, fraction: f64) -> usize {
        let [a, b, c] = [0, 1, 2].map(|i| self.nodes[n].corners[(edge + i) % 3]);
        let m = between(a, b, fraction);
        let parts = [self.add([a, m, c]), self.add([m, b, c])];
        let node = &mut self.nodes[n];
        (node.edge, node.fraction, node.parts) = (edge as i8, fraction, parts);
        parts[0] as usize
    }
}
