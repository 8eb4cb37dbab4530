//! From a domain to a tetrahedral mesh.

use super::{
    clip::{Draft, clip},
    domain::{Domain, PatchDistances, PatchSet},
    improve::improve,
    lattice::{Lattice, Placement},
    topology::{Adjacency, OuterFace, face_neighbors, largest_component, pinched_nodes},
};
use mammotwin_data::{
    Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// How to mesh.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Meshing {
    /// Edge length (mm), on average.
    pub size_mm: f64,
    /// How the lattice lies; another one gives an unrelated mesh of the same body.
    pub placement: Placement,
}

impl Meshing {
    /// Edges of `size_mm` on the usual lattice.
    pub fn of_size(size_mm: f64) -> Self {
        Self { size_mm, placement: Placement::default() }
    }
}

/// Why there is no mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// Size, placement or box is not usable.
    #[error("{0}")]
    BadInput(String),
    /// No element is inside.
    #[error("no tetrahedron of {size_mm} mm fits in the body; check its surfaces or mesh finer")]
    Empty {
        /// Edge length (mm).
        size_mm: f64,
    },
    /// The body touches itself.
    #[error(
        "the surface of the mesh touches itself near ({:.1}, {:.1}, {:.1}) mm; \
         the body is too thin there for {size_mm} mm elements", at.x, at.y, at.z
    )]
    NotManifold {
        /// Where (mm).
        at: Vec3,
        /// Edge length (mm).
        size_mm: f64,
    },
    /// An element could not be given a positive volume.
    #[error(
        "an element near ({:.1}, {:.1}, {:.1}) mm is flat; \
         the surfaces of the body are too rough for {size_mm} mm elements", at.x, at.y, at.z
    )]
    Flat {
        /// Where (mm).
        at: Vec3,
        /// Edge length (mm).
        size_mm: f64,
    },
}

/// Nodes that one lattice may have: about 40 million tetrahedra.
const MOST_POINTS: f64 = 1.6e7;

/// Meshes the largest connected part of a domain. `tissue` is asked at the centroid of each
/// tetrahedron.
///
/// Nodes of a patch lie on its zero surface within [`ON_SURFACE_MM`](super::domain::ON_SURFACE_MM);
/// nodes between patches lie on both. Where the body is thinner than an element and so would touch
/// itself, elements are dropped, up to a hundredth of its volume; nodes beside them lie on no patch.
/// Where a lattice meets a rough surface so that an element stays flat, it is shifted.
///
/// # Errors
/// [`MeshError`]: a box or size without sense, a body without elements, or one that is too thin or too
/// rough on every lattice.
pub fn tetrahedralize(
    domain: &dyn Domain,
    meshing: &Meshing,
    tissue: impl Fn(&Vec3) -> Tissue,
) -> Result<TetMesh, MeshError> {
    let first = on_lattice(domain, meshing, &tissue);
    if !matches!(first, Err(MeshError::Flat { .. } | MeshError::NotManifold { .. })) {
        return first;
    }
    let shifted = |n: usize| {
        let mut other = *meshing;
        for (offset, step) in other.placement.offset.iter_mut().zip(SHIFT) {
            *offset += n as f64 * step;
        }
        tracing::debug!(?other, "another lattice");
        on_lattice(domain, &other, &tissue).ok()
    };
    (1..LATTICES).find_map(shifted).map_or(first, Ok)
}

/// Lattices that are tried, and the way (cells) from one to the next.
const LATTICES: usize = 5;
const SHIFT: [f64; 3] = [0.37, 0.23, 0.31];

/// The mesh on the lattice of that placement.
pub(super) fn on_lattice(
    domain: &dyn Domain,
    meshing: &Meshing,
    tissue: impl Fn(&Vec3) -> Tissue,
) -> Result<TetMesh, MeshError> {
    let size_mm = meshing.size_mm;
    let lattice = lattice(domain, meshing)?;
    let (mut draft, patches) = lattice_draft(domain, &lattice);
    if patches.is_empty() {
        return Err(MeshError::BadInput("no surface bounds the body; name its patches".into()));
    }
    for patch in patches {
        clip(&mut draft, domain, patch, lattice.cell_mm());
        draft.keep_largest();
    }
    if draft.tets.is_empty() {
        return Err(MeshError::Empty { size_mm });
    }
    part_touching(&mut draft, size_mm)?;
    improve(&mut draft, domain, size_mm);
    let (_, outer) = face_neighbors(&draft.tets);
    if let Some(&node) = pinched_nodes(&outer).first() {
        return Err(MeshError::NotManifold { at: draft.points[node as usize], size_mm });
    }
    let centroid =
        |tet: &[u32; 4]| tet.iter().map(|&n| draft.points[n as usize]).sum::<Vec3>() / 4.0;
    if let Some(flat) = draft.tets.iter().find(|tet| TetMesh::tet_volume(&draft.points, tet) <= 0.0)
    {
        return Err(MeshError::Flat { at: centroid(flat), size_mm });
    }
    let tissues = draft.tets.iter().map(|tet| tissue(&centroid(tet))).collect();
    let patches = sort_faces(domain, &draft, &outer);
    Ok(TetMesh { points: draft.points, tets: draft.tets, tissues, patches })
}

fn lattice(domain: &dyn Domain, meshing: &Meshing) -> Result<Lattice, MeshError> {
    let Meshing { size_mm, placement } = meshing;
    if !(*size_mm > 0.0 && size_mm.is_finite()) {
        return Err(MeshError::BadInput(format!("size_mm is {size_mm}; give a positive length")));
    }
    if !placement.rotation.iter().chain(&placement.offset).all(|v| v.is_finite()) {
        return Err(MeshError::BadInput("the placement of the lattice is not finite".into()));
    }
    let (low, high) = domain.bounds();
    let extent = high - low;
    if !extent.iter().all(|&v| v >= 0.0 && v.is_finite()) {
        return Err(MeshError::BadInput(format!("the body has no box: {low:?} to {high:?} mm")));
    }
    let points = extent.map(|v| v.max(*size_mm) / size_mm).product();
    if points > MOST_POINTS {
        let least = size_mm * (points / MOST_POINTS).cbrt();
        return Err(MeshError::BadInput(format!(
            "size_mm {size_mm} gives too many elements; take at least {least:.2}"
        )));
    }
    Ok(Lattice::covering((low, high), *size_mm, placement))
}

/// The part of the lattice that may meet the body, and the patches of the body.
fn lattice_draft(domain: &dyn Domain, lattice: &Lattice) -> (Draft, Vec<Patch>) {
    let points = lattice.points();
    let distances: Vec<PatchDistances> = points.par_iter().map(|p| domain.distances(p)).collect();
    let patches: Vec<Patch> = distances.first().map_or(Vec::new(), |d| d.patches().collect());
    let tets = lattice.tets(|tet| {
        let inside = |&patch: &Patch| tet.iter().any(|&n| distances[n as usize].of(patch) < 0.0);
        patches.iter().all(inside)
    });
    let on = vec![PatchSet::NONE; points.len()];
    let mut draft = Draft { points, on, tets };
    draft.compact();
    (draft, patches)
}

impl Draft {
    /// Forgets nodes that no tetrahedron has.
    pub fn compact(&mut self) {
        let mut new = vec![u32::MAX; self.points.len()];
        self.tets.iter().flatten().for_each(|&n| new[n as usize] = 0);
        let mut count = 0;
        for n in 0..new.len() {
            if new[n] == 0 {
                new[n] = count;
                self.points[count as usize] = self.points[n];
                self.on[count as usize] = self.on[n];
                count += 1;
            }
        }
        self.points.truncate(count as usize);
        self.on.truncate(count as usize);
        self.tets.iter_mut().flatten().for_each(|n| *n = new[*n as usize]);
    }

    /// Keeps the largest part that hangs together through faces.
    pub fn keep_largest(&mut self) {
        let mut keep = largest_component(&self.tets).into_iter();
        self.tets.retain(|_| keep.next().unwrap_or(false));
        self.compact();
    }
}

/// Most of the volume that may be dropped where the body is thinner than an element.
const MOST_DROPPED: f64 = 0.01;

/// Drops elements where the body touches itself: around such a node all but the largest part, or
/// all when they hang together.
fn part_touching(draft: &mut Draft, size_mm: f64) -> Result<(), MeshError> {
    let volume = |draft: &Draft| -> f64 {
        draft.tets.iter().map(|tet| TetMesh::tet_volume(&draft.points, tet)).sum()
    };
    let whole = volume(draft);
    loop {
        let (_, outer) = face_neighbors(&draft.tets);
        let pinched = pinched_nodes(&outer);
        let Some(&first) = pinched.first() else { return Ok(()) };
        let at = draft.points[first as usize];
        let adjacency = Adjacency::new(draft.points.len(), &draft.tets);
        let mut keep = vec![true; draft.tets.len()];
        for node in pinched {
            let star = adjacency.of(node as usize);
            let tets: Vec<[u32; 4]> = star.iter().map(|&t| draft.tets[t as usize]).collect();
            let largest = largest_component(&tets);
            let whole = largest.iter().all(|&part| part);
            for (&t, part) in star.iter().zip(largest) {
                keep[t as usize] &= part && !whole;
            }
        }
        let mut keep = keep.into_iter();
        draft.tets.retain(|_| keep.next().unwrap_or(false));
        draft.keep_largest();
        if volume(draft) < (1.0 - MOST_DROPPED) * whole {
            return Err(MeshError::NotManifold { at, size_mm });
        }
    }
}

/// Outer faces by patch: the surface that all three corners lie on; where that is not one, the
/// surface nearest to the middle.
fn sort_faces(
    domain: &dyn Domain,
    draft: &Draft,
    outer: &[OuterFace],
) -> BTreeMap<Patch, Vec<[u32; 3]>> {
    let mut patches: BTreeMap<Patch, Vec<[u32; 3]>> = BTreeMap::new();
    for face in outer {
        let [a, b, c] = face.corners.map(|n| draft.on[n as usize]);
        let middle = face.corners.iter().map(|&n| draft.points[n as usize]).sum::<Vec3>() / 3.0;
        let distances = domain.distances(&middle);
        let common = a.and(b).and(c);
        let candidates = distances.patches().filter(|&p| common.is_empty() || common.has(p));
        let distance = |patch: &Patch| distances.of(*patch).abs();
        let nearest = candidates.min_by(|p, q| distance(p).total_cmp(&distance(q)));
        if let Some(patch) = nearest {
            patches.entry(patch).or_default().push(face.corners);
        }
    }
    patches
}
