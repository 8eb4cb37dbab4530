//! Cutting a mesh along one surface of a domain: nodes near it are moved onto it, elements that
//! still cross it are divided.

use super::{
    domain::{Domain, ON_SURFACE_MM, PatchSet, project},
    quality::equivolume,
    topology::Adjacency,
};
use mammotwin_data::{Vec3, mesh::Patch};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A mesh under construction.
#[derive(Debug, Clone, Default)]
pub struct Draft {
    /// Nodes (mm).
    pub points: Vec<Vec3>,
    /// Surfaces that each node lies on.
    pub on: Vec<PatchSet>,
    /// Tetrahedra.
    pub tets: Vec<[u32; 4]>,
}

/// Nodes nearer than this, in lattice cells, are moved onto the surface instead of cutting beside
/// them: about what keeps the angles of Labelle & Shewchuk (2007, § 5) largest.
const WARP: f64 = 0.28;
/// A node that lies on other surfaces already may move this far along them, in lattice cells.
const WARP_ALONG: f64 = 0.42;
/// Shape that a move onto the surface must leave to its tetrahedra.
const WARPED_SHAPE: f64 = 0.05;

/// Keeps the part of `draft` with negative distance to `patch`.
pub fn clip(draft: &mut Draft, domain: &dyn Domain, patch: Patch, cell_mm: f64) {
    let mut distance: Vec<f64> =
        draft.points.par_iter().map(|p| domain.distance(p, patch)).collect();
    warp(draft, domain, patch, cell_mm, &mut distance);
    cut(draft, domain, patch, cell_mm, &distance);
}

/// Moves nodes near the surface onto it; their distance becomes exactly zero.
fn warp(draft: &mut Draft, domain: &dyn Domain, patch: Patch, cell_mm: f64, distance: &mut [f64]) {
    let adjacency = Adjacency::new(draft.points.len(), &draft.tets);
    for node in 0..draft.points.len() {
        if distance[node].abs() > WARP * cell_mm {
            continue;
        }
        let set = draft.on[node];
        let reach = if set.is_empty() { 1.2 * WARP } else { WARP_ALONG };
        let target = project(domain, &draft.points[node], set.with(patch), reach * cell_mm);
        let Some(target) = target else { continue };
        let old = std::mem::replace(&mut draft.points[node], target);
        let shape =
            |&t: &u32| equivolume(&draft.tets[t as usize].map(|n| draft.points[n as usize]));
        if adjacency.of(node).iter().map(shape).fold(f64::INFINITY, f64::min) < WARPED_SHAPE {
            draft.points[node] = old;
        } else {
            draft.on[node] = set.with(patch);
            distance[node] = 0.0;
        }
    }
}

/// Divides the tetrahedra that cross the surface and drops what is outside.
fn cut(draft: &mut Draft, domain: &dyn Domain, patch: Patch, cell_mm: f64, distance: &[f64]) {
    let mut cuts: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut kept = Vec::with_capacity(draft.tets.len());
    for tet in std::mem::take(&mut draft.tets) {
        let value = tet.map(|n| distance[n as usize]);
        if value.iter().all(|&v| v >= 0.0) {
            continue;
        }
        if value.iter().all(|&v| v <= 0.0) {
            kept.push(tet);
            continue;
        }
        let mut at = |inside: u32, outside: u32| {
            let key = [inside.min(outside), inside.max(outside)];
            *cuts.entry(key).or_insert_with(|| {
                let (point, on) =
                    crossing(draft, domain, patch, cell_mm, distance, [inside, outside]);
                draft.points.push(point);
                draft.on.push(on);
                draft.points.len() as u32 - 1
            })
        };
        divide(&tet, &value, &mut at, &mut kept);
    }
    draft.tets = kept;
}

/// Point of an edge on the surface, and the surfaces it lies on.
fn crossing(
    draft: &Draft,
    domain: &dyn Domain,
    patch: Patch,
    cell_mm: f64,
    distance: &[f64],
    [inside, outside]: [u32; 2],
) -> (Vec3, PatchSet) {
    let [a, b] = [inside, outside].map(|n| draft.points[n as usize]);
    let at = |part: f64| domain.distance(&a.lerp(&b, part), patch);
    let part = root(at, distance[inside as usize], distance[outside as usize]);
    let on = draft.on[inside as usize].and(draft.on[outside as usize]).with(patch);
    let point = a.lerp(&b, part);
    // The edge is a chord of the surfaces that both ends lie on: back onto them.
    (project(domain, &point, on, 0.3 * cell_mm).unwrap_or(point), on)
}

/// Where between 0 and 1 a function vanishes that is `low` < 0 at 0 and `high` > 0 at 1: regula falsi
/// as Illinois has it (Dowell & Jarratt 1971, doi:10.1007/BF01934364).
fn root(function: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let (mut left, mut right) = (0.0, 1.0);
    let mut part = 0.5;
    for _ in 0..40 {
        part = (left * high - right * low) / (high - low);
        let value = function(part);
        if value.abs() < 1e-3 * ON_SURFACE_MM {
            break;
        }
        // An end that stays is given half of its weight, so that it will be left, too.
        if value < 0.0 {
            (left, low, high) = (part, value, 0.5 * high);
        } else {
            (right, high, low) = (part, value, 0.5 * low);
        }
    }
    part
}

/// A corner of a piece: a corner of the divided tetrahedron, or the middle of one of its edges as a
/// stand-in for the cut, and its node.
#[derive(Clone, Copy)]
struct Corner {
    node: u32,
    /// Barycentric position without its first component: enough to orient a piece.
    place: Vec3,
    /// Distance to the surface: diagonals start at the corner nearest to it.
    rank: f64,
}

/// Pushes the pieces of one tetrahedron inside of the surface.
fn divide(
    tet: &[u32; 4],
    value: &[f64; 4],
    at: &mut impl FnMut(u32, u32) -> u32,
    pieces: &mut Vec<[u32; 4]>,
) {
    let places = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
    let corner = |n: usize| Corner { node: tet[n], place: places[n], rank: value[n] };
    let of =
        |sign: fn(f64) -> bool| (0..4).filter(|&n| sign(value[n])).map(corner).collect::<Vec<_>>();
    let (inside, zero, outside) = (of(|v| v < 0.0), of(|v| v == 0.0), of(|v| v > 0.0));
    let mut between = |a: &Corner, b: &Corner| Corner {
        node: at(a.node, b.node),
        place: 0.5 * (a.place + b.place),
        rank: f64::NEG_INFINITY,
    };
    match (inside.as_slice(), zero.as_slice(), outside.as_slice()) {
        ([i], rest, out) => {
            let mut corners = vec![*i];
            corners.extend_from_slice(rest);
            corners.extend(out.iter().map(|o| between(i, o)));
            push(pieces, [corners[0], corners[1], corners[2], corners[3]]);
        }
        ([i, j], [z], [o]) => {
            let (p, q) = (between(i, o), between(j, o));
            pyramid(pieces, *z, [*i, *j, q, p]);
        }
        ([i, j], [], [o, p]) => {
            let near = [*i, between(i, o), between(i, p)];
            let far = [*j, between(j, o), between(j, p)];
            prism(pieces, near, far);
        }
        ([i, j, k], [], [o]) => {
            prism(pieces, [*i, *j, *k], [between(i, o), between(j, o), between(k, o)]);
        }
        _ => unreachable!("a tetrahedron with corners on both sides has one of these signs"),
    }
}

/// Whether diagonals start at `a` rather than at `b`: the same answer in both tetrahedra of a face.
fn first(a: &Corner, b: &Corner) -> bool {
    (a.rank, b.node) > (b.rank, a.node)
}

/// Pyramid over a quadrilateral, divided by the diagonal of its first corner.
fn pyramid(pieces: &mut Vec<[u32; 4]>, apex: Corner, quad: [Corner; 4]) {
    let [a, b, c, d] = quad;
    let best = |a, b| if first(&a, &b) { a } else { b };
    if first(&best(a, c), &best(b, d)) {
        push(pieces, [apex, a, b, c]);
        push(pieces, [apex, a, c, d]);
    } else {
        push(pieces, [apex, b, c, d]);
        push(pieces, [apex, b, d, a]);
    }
}

/// Prism between two triangles, divided by diagonals from the first corner of each side.
fn prism(pieces: &mut Vec<[u32; 4]>, mut near: [Corner; 3], mut far: [Corner; 3]) {
    let all = [near, far].concat();
    let top = (1..6).fold(0, |best, n| if first(&all[n], &all[best]) { n } else { best });
    if top >= 3 {
        std::mem::swap(&mut near, &mut far);
    }
    near.rotate_left(top % 3);
    far.rotate_left(top % 3);
    push(pieces, [near[0], far[0], far[1], far[2]]);
    pyramid(pieces, near[0], [near[1], near[2], far[2], far[1]]);
}

/// Adds a piece with positive orientation, judged on the stand-ins: cuts that lie close together
/// must not decide it.
fn push(pieces: &mut Vec<[u32; 4]>, corners: [Corner; 4]) {
    let [a, b, c, d] = corners.map(|corner| corner.place);
    let mut nodes = corners.map(|corner| corner.node);
    if (b - a).dot(&(c - a).cross(&(d - a))) < 0.0 {
        nodes.swap(2, 3);
    }
    pieces.push(nodes);
}
