//! Rooms: points between which light can pass, by however many ways. A residual that is small beside
//! the light of a whole scene may be all the light of a room that it never reaches, so every room is
//! held to its own.

use super::form_factor::plane_distances;
use crate::points::{NO_POINT, SamplePoints};
use crate::sets::Sets;
use crate::visibility::{Edge, Links, VisibilityGraph};

/// Weaker than this beside the strongest, a room is as good as dark to `f32`.
const WEAKEST: f64 = 1e-15;

/// The room of each point, and what it depends on but for geometry.
pub struct Rooms {
    /// Whether light goes through the surface at each point.
    passes: Vec<bool>,
    /// Numbered from 0.
    pub room: Vec<u32>,
}

impl Rooms {
    /// Finds the rooms, unless those `kept` are the same. `passes` says whether light goes through the surface
    /// at a point.
    pub fn new(
        points: &SamplePoints,
        graph: &VisibilityGraph,
        tolerance: f32,
        passes: impl Fn(usize) -> bool,
        kept: Option<Rooms>,
    ) -> Self {
        let passes: Vec<bool> = (0..points.len()).map(passes).collect();
        match kept {
            Some(kept) if kept.passes == passes => kept,
            _ => Rooms { room: rooms(points, graph, tolerance, |i| passes[i]), passes },
        }
    }
}

/// The room of each point.
fn rooms(
    points: &SamplePoints,
    graph: &VisibilityGraph,
    tolerance: f32,
    passes: impl Fn(usize) -> bool,
) -> Vec<u32> {
    const NONE: u32 = u32::MAX;
    let mut room = vec![NONE; points.len()];
    let mut left: Vec<Vec<u32>> =
        (0..points.voxels()).map(|v| points.voxel(v).map(|i| i as u32).collect()).collect();
    let voxel_of: Vec<usize> = (0..points.voxels()).flat_map(|v| points.voxel(v).map(move |_| v)).collect();
    let faces = |i: usize, j: usize| {
        let (d_i, d_j, _) = plane_distances(points, i, j);
        !points.share_plane(i, j) && d_i > tolerance && d_j > tolerance
    };
    let (mut count, mut stack) = (0, Vec::new());
    for first in 0..points.len() {
        if room[first] != NONE {
            continue;
        }
        room[first] = count;
        stack.push(first);
        while let Some(i) = stack.pop() {
            let twin = points.twin[i];
            if twin != NO_POINT && passes(i) && room[twin as usize] == NONE {
                room[twin as usize] = count;
                stack.push(twin as usize);
            }
            for (b, left) in left.iter_mut().enumerate() {
                if left.is_empty() || graph.edge(voxel_of[i], b) == Edge::Hidden {
                    continue;
                }
                left.retain(|&j| {
                    let j = j as usize;
                    if room[j] == NONE && graph.unblocked(i, j) && faces(i, j) {
                        room[j] = count;
                        stack.push(j);
                    }
                    room[j] == NONE
                });
            }
        }
        count += 1;
    }
    room
}

/// The room of each point, as far as links tell: all that a point is linked to is in its room.
pub fn linked_rooms(links: &Links) -> Vec<u32> {
    let hierarchy = &links.hierarchy;
    let n = hierarchy.order.len();
    let mut rooms = Sets::new(n);
    let mut joined = vec![false; hierarchy.clusters.len()];
    for i in 0..n {
        for (c, _) in links.row(i) {
            let of = hierarchy.points(c);
            // The points of a cluster need to be joined with each other once.
            let of = if std::mem::replace(&mut joined[c], true) { &of[..1] } else { of };
            of.iter().for_each(|&j| rooms.join(i as u32, j));
        }
    }
    let mut room: Vec<u32> = Vec::with_capacity(n);
    let mut count = 0;
    for i in 0..n as u32 {
        let first = rooms.of(i);
        // The first point of a room leads it.
        room.push(if first == i { count } else { room[first as usize] });
        count += u32::from(first == i);
    }
    room
}

/// Makes one room of those on both sides of every point where light `passes` the surface.
pub fn joined(room: &[u32], points: &SamplePoints, passes: impl Fn(usize) -> bool) -> Vec<u32> {
    let mut rooms = Sets::new(room.iter().max().map_or(0, |&last| last as usize + 1));
    for i in (0..room.len()).filter(|&i| points.twin[i] != NO_POINT && passes(i)) {
        rooms.join(room[i], room[points.twin[i] as usize]);
    }
    room.iter().map(|&r| rooms.of(r)).collect()
}

/// Weights of the points in the norm of a residual: their areas over the square of how strong their
/// room's `sources`, `[W][N]`, are beside the strongest room's. Dark rooms count as they are.
pub fn weights(points: &SamplePoints, room: &[u32], sources: &[f32]) -> Vec<f32> {
    let n = points.len();
    let count = room.iter().max().map_or(0, |&last| last as usize + 1);
    let mut strength = vec![0.0f64; count];
    for (i, &room) in room.iter().enumerate() {
        let all: f64 = sources.iter().skip(i).step_by(n.max(1)).map(|l| f64::from(l.abs())).sum();
        strength[room as usize] += all * f64::from(points.area[i]);
    }
    let most = strength.iter().copied().fold(0.0, f64::max);
    let weight = |(&area, &room): (&f32, &u32)| {
        let share = strength[room as usize] / most;
        if share > 0.0 { (f64::from(area) / share.max(WEAKEST).powi(2)) as f32 } else { area }
    };
    points.area.iter().zip(room).map(weight).collect()
}
