//! The pectoral muscle as a body of its own, behind the breast.
//!
//! It is a layer of columns: each node of the breast's rear has a column of nodes that goes from the front
//! of the muscle to the ribs, and the prisms between the columns are cut into tetrahedra. Front of the
//! muscle and rear of the breast so have the same nodes and faces at rest: where the breast is bonded, the
//! muscle's elements take the breast's nodes for their own, which passes tractions exactly, and the nodes
//! of the muscle's own front have no use.
//!
//! The nodes of the muscle follow those of the breast in every list of nodes.

use super::{LawError, Recipe, interface::wall_shift};
use crate::mesh::soft_max;
use mammotwin_data::{
    Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
    study::{InterfacePlan, LawName},
};
use mammotwin_solver::{
    materials::Law,
    mesh::{
        crop::Cropped,
        quality::{Summary, quality},
    },
    model::{Model, ModelError},
    terms::{Bulk, Front, Gravity, Target},
};
use serde::{Deserialize, Serialize};

/// Elements across the muscle: enough for a shear that falls off linearly, as under its own weight.
pub const LAYERS: usize = 2;
/// Least thickness (mm): the wall has a muscle everywhere, so that it is one body; where there is none in
/// truth it gives way little, since it is thin.
pub const THINNEST_MM: f64 = 4.0;
/// Poisson's ratio: nearly incompressible.
const POISSON: f64 = 0.49;
/// Rounds in which thickness and direction of the columns become alike those of their neighbours.
const SMOOTHING: usize = 4;

/// A layer of muscle behind the breast.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Muscle {
    /// Nodes of the breast's rear, ascending; each has a column.
    pub wall: Vec<u32>,
    /// First node of the first column. Column c has the nodes `first + 3 c ..`, front to rear.
    pub first: u32,
    /// Tetrahedra, from column front to rear, behind the faces of the breast's rear.
    pub tets: Vec<[u32; 4]>,
    /// Their shape in the reference pose.
    pub quality: Summary,
}

impl Muscle {
    /// Puts a muscle behind the rear of `mesh`, whose nodes grow by those of the muscle.
    ///
    /// From each node of the rear it goes along the normal of the `front` as far as the ribs are away (mm) by `ribs_mm`,
    /// and 4 mm at least.
    pub fn behind(mesh: &mut TetMesh, front: &dyn Target, ribs_mm: impl Fn(&Vec3) -> f64) -> Self {
        let column =
            |p: &Vec3| (soft_max(ribs_mm(p), THINNEST_MM, THINNEST_MM), -front.distance(p).1);
        let wall = mesh.patch_nodes(Patch::ChestWall);
        let faces = mesh.patch(Patch::ChestWall).to_vec();
        let number = |node: u32| wall.binary_search(&node).unwrap_or_default();
        let mut columns: Vec<(f64, Vec3)> =
            wall.iter().map(|&n| column(&mesh.points[n as usize])).collect();
        for _ in 0..SMOOTHING {
            columns = smoothed(&columns, &faces, number);
        }
        let first = mesh.points.len() as u32;
        for (&node, (thickness_mm, inward)) in wall.iter().zip(&columns) {
            let front = mesh.points[node as usize];
            let inward = inward.try_normalize(1e-9).unwrap_or_else(Vec3::zeros);
            for layer in 0..=LAYERS {
                let part = layer as f64 / LAYERS as f64;
                mesh.points.push(front + part * thickness_mm * inward);
            }
        }
        Self::of(wall, first, &faces, &mesh.points)
    }

    /// The muscle behind some faces of the breast's rear.
    fn of(wall: Vec<u32>, first: u32, faces: &[[u32; 3]], points: &[Vec3]) -> Self {
        let mut muscle = Self { wall, first, tets: Vec::new(), quality: Summary::default() };
        for face in faces {
            // Cut along diagonals from the smaller number of a column: alike in both prisms that share them.
            let mut columns = face.map(|n| muscle.column(n));
            columns.sort_unstable();
            for layer in 0..LAYERS {
                let front = columns.map(|c| muscle.node(c, layer));
                let rear = columns.map(|c| muscle.node(c, layer + 1));
                let cut = [
                    [front[0], front[1], front[2], rear[2]],
                    [front[0], front[1], rear[1], rear[2]],
                    [front[0], rear[0], rear[1], rear[2]],
                ];
                muscle.tets.extend(cut.map(|tet| upright(tet, points)));
            }
        }
        muscle.quality = quality(points, &muscle.tets).summary;
        muscle
    }

    /// The muscle behind a part of the breast, and the nodes of the whole that it takes with it; the nodes
    /// of the part are those of the breast alone. `points` are the whole's (mm).
    pub fn cropped(&self, part: &mut Cropped, points: &[Vec3]) -> Self {
        let wall = part.mesh.patch_nodes(Patch::ChestWall);
        let faces = part.mesh.patch(Patch::ChestWall).to_vec();
        let first = part.mesh.points.len() as u32;
        for &node in &wall {
            let column = self.column(part.nodes[node as usize]);
            for layer in 0..=LAYERS {
                let node = self.node(column, layer);
                part.nodes.push(node);
                part.mesh.points.push(points[node as usize]);
            }
        }
        Self::of(wall, first, &faces, &part.mesh.points)
    }

    /// Number of the column behind a node of the breast's rear.
    fn column(&self, wall: u32) -> usize {
        self.wall.binary_search(&wall).unwrap_or_default()
    }

    /// Node of a column: layer 0 is the muscle's front, [`LAYERS`] its rear.
    fn node(&self, column: usize, layer: usize) -> u32 {
        self.first + (column * (LAYERS + 1) + layer) as u32
    }

    /// Nodes of the muscle's front and the nodes of the breast before them.
    pub fn front(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.wall.iter().enumerate().map(|(column, &wall)| (self.node(column, 0), wall))
    }

    /// Tetrahedra of the muscle that have the breast's nodes for their front where `bonded` says so of a
    /// node of the breast's rear.
    pub fn joined(&self, bonded: impl Fn(u32) -> bool) -> Vec<[u32; 4]> {
        let per_column = LAYERS as u32 + 1;
        let own = |node: u32| {
            let behind = node - self.first;
            let wall = self.wall[(behind / per_column) as usize];
            if behind.is_multiple_of(per_column) && bonded(wall) { wall } else { node }
        };
        self.tets.iter().map(|tet| tet.map(own)).collect()
    }

    /// Its front as the breast glides on it, where it does not have the breast's nodes.
    ///
    /// # Errors
    /// Never for the muscle of this breast.
    pub(super) fn smooth_front(
        &self,
        body: &super::Body,
        plan: &InterfacePlan,
    ) -> Result<Front, ModelError> {
        let bonded = |node: u32| body.is_bonded(plan, node);
        let own = |node: u32| if bonded(node) { node } else { self.node(self.column(node), 0) };
        let faces = body.mesh.patch(Patch::ChestWall).iter();
        let faces: Vec<[u32; 3]> = faces.map(|&[a, b, c]| [a, c, b].map(own)).collect();
        Front::new(body.wall.clone(), &body.mesh.points, &faces, &self.joined(bonded))
    }

    /// Moves the nodes of the muscle's own front to those of the breast where it is bonded.
    pub fn follow<T: Copy>(&self, of_nodes: &mut [T], bonded: impl Fn(u32) -> bool) {
        for (own, wall) in self.front().filter(|(_, wall)| bonded(*wall)) {
            of_nodes[own as usize] = of_nodes[wall as usize];
        }
    }

    /// Adds tissue, weight and supports of the muscle to the model of a breast.
    ///
    /// # Errors
    /// A modulus without meaning, or a rest shape with an element without volume.
    pub(super) fn add(
        &self,
        model: &mut Model,
        body: &super::Body,
        recipe: &Recipe,
        rest: &[Vec3],
    ) -> Result<(), MuscleError> {
        let bonded = |node: u32| body.is_bonded(&recipe.interface, node);
        let tets = self.joined(bonded);
        let law = Law::new(LawName::NeoHookean, body.plan.muscle.young_kpa, POISSON, None)?;
        let laws = vec![law; tets.len()];
        let tissues = vec![Tissue::PectoralMuscle; tets.len()];
        let mesh = TetMesh { points: rest.to_vec(), tets, tissues, ..TetMesh::default() };
        model.add(Bulk::new("muscle", &mesh, laws)?)?;
        if recipe.gravity != Vec3::zeros() {
            let density = recipe.density_g_per_cm3;
            model.add(Gravity::new("muscle_gravity", &mesh, density, recipe.gravity))?;
        }
        let reference = &body.mesh.points;
        for (column, &wall) in self.wall.iter().enumerate() {
            let front = &reference[wall as usize];
            let stuck = bonded(wall);
            let shift = wall_shift(body, front, if stuck { recipe.wall_shift_mm } else { 0.0 });
            let rear = self.node(column, LAYERS);
            model.hold(rear, reference[rear as usize] + shift);
            if stuck {
                // Nothing hangs on it.
                let own = self.node(column, 0);
                model.hold(own, reference[own as usize]);
            }
        }
        // The muscle goes on beyond the cuts: glued, it moves along them alone; where the breast slides past
        // them on what is at rest there, it rests, too.
        for (cut, axis) in [
            (Patch::Superior, 2),
            (Patch::Inferior, 2),
            (Patch::LateralRight, 1),
            (Patch::LateralLeft, 1),
        ] {
            for wall in body.mesh.patch_nodes(cut) {
                let Ok(column) = self.wall.binary_search(&wall) else { continue };
                let within = (1..LAYERS).map(|n| self.node(column, n));
                if bonded(wall) {
                    [wall].into_iter().chain(within).for_each(|node| model.fix(node, axis));
                    continue;
                }
                for node in [self.node(column, 0)].into_iter().chain(within) {
                    model.hold(node, reference[node as usize]);
                }
            }
        }
        Ok(())
    }

    /// All nodes of the columns behind some nodes of the breast.
    pub fn behind_nodes<'a>(&'a self, nodes: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        let columns = nodes.iter().filter_map(|node| self.wall.binary_search(node).ok());
        columns.flat_map(move |column| (0..=LAYERS).map(move |layer| self.node(column, layer)))
    }
}

/// Why a muscle cannot be modelled.
#[derive(Debug, thiserror::Error)]
pub(super) enum MuscleError {
    #[error(transparent)]
    Law(#[from] LawError),
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// A tetrahedron of positive volume with these corners.
fn upright(tet: [u32; 4], points: &[Vec3]) -> [u32; 4] {
    let [a, b, c, d] = tet;
    if TetMesh::tet_volume(points, &tet) < 0.0 { [b, a, c, d] } else { tet }
}

/// The mean of each column and its neighbours.
fn smoothed(
    columns: &[(f64, Vec3)],
    faces: &[[u32; 3]],
    number: impl Fn(u32) -> usize,
) -> Vec<(f64, Vec3)> {
    let mut sums: Vec<(f64, Vec3, f64)> = columns.iter().map(|(t, n)| (*t, *n, 1.0)).collect();
    for face in faces {
        let corners = face.map(&number);
        // Each edge is met once from either of its faces.
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            for (to, from) in [(corners[a], corners[b]), (corners[b], corners[a])] {
                let sum = &mut sums[to];
                sum.0 += 0.5 * columns[from].0;
                sum.1 += 0.5 * columns[from].1;
                sum.2 += 0.5;
            }
        }
    }
    sums.into_iter().map(|(t, n, weight)| (t / weight, n / weight)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::progress::Silent;
    use mammotwin_solver::{
        Options,
        mesh::{
            domain::{Domain, PatchDistances},
            tetrahedralize::{Meshing, tetrahedralize},
        },
        solve,
        terms::target::Plane,
    };

    /// A block above z = 0 on a flat wall.
    struct Slab {
        half_mm: f64,
        high_mm: f64,
    }

    impl Domain for Slab {
        fn distances(&self, p: &Vec3) -> PatchDistances {
            PatchDistances::none()
                .with(Patch::ChestWall, -p.z)
                .with(Patch::Skin, p.z - self.high_mm)
                .with(Patch::Superior, p.x - self.half_mm)
                .with(Patch::Inferior, -self.half_mm - p.x)
                .with(Patch::LateralRight, p.y - self.half_mm)
                .with(Patch::LateralLeft, -self.half_mm - p.y)
        }

        fn bounds(&self) -> (Vec3, Vec3) {
            let h = self.half_mm;
            (Vec3::new(-h, -h, 0.0), Vec3::new(h, h, self.high_mm))
        }
    }

    const THICK_MM: f64 = 10.0;
    const UP: Plane = Plane { point: Vec3::new(0.0, 0.0, 0.0), normal: Vec3::new(0.0, 0.0, 1.0) };

    /// A block of 20 mm and 10 mm of muscle below it.
    fn slab() -> (TetMesh, Muscle) {
        let slab = Slab { half_mm: 30.0, high_mm: 20.0 };
        let tissue = |_: &Vec3| Tissue::AdiposeRight;
        let mut mesh = tetrahedralize(&slab, &Meshing::of_size(8.0), tissue).unwrap();
        let muscle = Muscle::behind(&mut mesh, &UP, |_| THICK_MM);
        (mesh, muscle)
    }

    /// Breast of `kpa[0]` and muscle of `kpa[1]`, of a law without pressure in shear.
    fn model(mesh: &TetMesh, muscle: &Muscle, kpa: [f64; 2]) -> Model {
        let law = |kpa: f64| Law::neo_hookean_coupled(kpa, 0.45).unwrap();
        let mut model = Model::new(mesh);
        let breast = Bulk::new("breast", mesh, vec![law(kpa[0]); mesh.tets.len()]);
        model.add(breast.unwrap()).unwrap();
        let behind = TetMesh { tets: muscle.joined(|_| true), ..mesh.clone() };
        let laws = vec![law(kpa[1]); behind.tets.len()];
        model.add(Bulk::new("muscle", &behind, laws).unwrap()).unwrap();
        for (own, _) in muscle.front() {
            model.hold(own, mesh.points[own as usize]);
        }
        model
    }

    /// Verifies: breast glued to a muscle 20 times as stiff, both sheared from outside, patch test | tractions alike: γ G on both sides | 1e-6 mm
    #[test]
    fn shear_goes_through_the_joint_exactly() {
        let (mesh, muscle) = slab();
        let kpa = [0.5, 10.0];
        let mut model = model(&mesh, &muscle, kpa);
        // A shear of 0.1 in the breast.
        let slope = |z: f64| if z > 0.0 { 0.1 } else { 0.1 * kpa[0] / kpa[1] };
        let exact = |p: &Vec3| {
            let x = 0.1 * kpa[0] / kpa[1] * THICK_MM + slope(p.z) * p.z;
            p + Vec3::new(x, 0.0, 0.0)
        };
        let fronts: Vec<u32> = muscle.front().map(|(own, _)| own).collect();
        let outside = |p: &Vec3| {
            p.x.abs().max(p.y.abs()) > 30.0 - 0.02 || p.z > 20.0 - 0.02 || p.z < -THICK_MM + 0.02
        };
        let mut inner = Vec::new();
        for (n, p) in mesh.points.iter().enumerate() {
            let node = n as u32;
            if fronts.contains(&node) {
                continue;
            }
            if outside(p) { model.hold(node, exact(p)) } else { inner.push(n) }
        }
        let found = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
        let off = inner.iter().map(|&n| (found.points[n] - exact(&mesh.points[n])).norm());
        let most = off.fold(0.0, f64::max);
        let on_front = inner.iter().filter(|&&n| mesh.points[n].z.abs() < 0.02).count();
        println!("{} inner nodes, {on_front} on the joint, {most:.1e} mm off", inner.len());
        assert!(on_front > 10 && most < 1e-6);
    }

    /// Verifies: displacement of the front of a thin layer under the weight of what hangs on it along the wall | u = (ρ g / G) (H h + h²/2) | 1 %
    #[test]
    fn a_layer_gives_way_as_in_simple_shear() {
        let (mesh, muscle) = slab();
        let kpa = 10.0;
        let mut model = model(&mesh, &muscle, [0.5, kpa]);
        let down = Vec3::x();
        let behind = TetMesh { tets: muscle.joined(|_| true), ..mesh.clone() };
        model.add(Gravity::new("gravity", &mesh, 0.981, down)).unwrap();
        model.add(Gravity::new("muscle_gravity", &behind, 0.981, down)).unwrap();
        for (n, p) in mesh.points.iter().enumerate() {
            let node = n as u32;
            // Far from its ends a wide layer moves along itself alone.
            model.fix(node, 1);
            model.fix(node, 2);
            if p.z < -THICK_MM + 0.02 {
                model.fix_node(node);
            }
        }
        let found = solve(&model, &mesh.points, &Options::default(), &Silent).unwrap();
        let shear_kpa = kpa / (2.0 * 1.45);
        let weight = 0.981 * 9.80665e-3;
        let exact = weight / shear_kpa * (20.0 * THICK_MM + 0.5 * THICK_MM * THICK_MM);
        let middle = |p: &Vec3| p.x.abs() < 12.0 && p.y.abs() < 12.0;
        let front: Vec<f64> = muscle
            .front()
            .map(|(_, wall)| wall as usize)
            .filter(|&n| middle(&mesh.points[n]))
            .map(|n| found.points[n].x - mesh.points[n].x)
            .collect();
        let mean = front.iter().sum::<f64>() / front.len() as f64;
        println!("{mean:.4} mm over {} nodes, exactly {exact:.4}", front.len());
        assert!((mean / exact - 1.0).abs() < 0.01);
    }
}
