//! A pose as a target: what was measured there, and how far a simulated body is from it.

use crate::{
    correspondence::Correspondence,
    mesh::BreastMesh,
    model::{Body, Moduli},
    register::Registered,
    scan,
    shape::Shape,
    surface::PoseSurfaces,
};
use mammotwin_data::{
    Failure, Vec3, io::hdf5, labels::Side, mesh::Patch, progress::Silent, rigid::RigidTransform,
    solution::Solution, surface::TriMesh,
};
use mammotwin_solver::{
    Options,
    distance::{Closest, DistanceError, Distances, SurfaceIndex},
    solve, solve_near,
};
use std::{collections::BTreeSet, sync::Arc};

/// Skin within this elliptic radius of a breast's base is compared; arms and cuts are not.
const ACTIVE_RADIUS: f64 = 1.15;
/// Skin this near (mm) to a cut is not compared: the model's limit is not the person's.
const CUT_MARGIN_MM: f64 = 15.0;
/// Measured skin this far (mm) beyond the compared nodes may correspond to them.
const RIM_MM: f64 = 20.0;

/// What was measured in one pose, in the frame of the reference pose.
pub struct PoseTarget {
    /// Name of the pose.
    pub pose: String,
    /// Unit vector of gravity.
    pub gravity: Vec3,
    /// From the pose's image to the reference pose's frame.
    motion: RigidTransform,
    measured: Arc<MeasuredSkin>,
    /// The simulated skin's triangles, and the nodes that are compared.
    faces: Vec<[u32; 3]>,
    active: Vec<u32>,
    /// Side of each active node.
    sides: Vec<Side>,
}

/// What was measured, in the frame of the reference pose: the same for all meshes of a model.
struct MeasuredSkin {
    skin: TriMesh,
    index: SurfaceIndex,
}

/// A simulated pose beside the measured one.
#[derive(Debug, Clone)]
pub struct PoseFit {
    /// Name of the pose.
    pub pose: String,
    /// Unit vector of gravity in the reference pose's frame.
    pub gravity: Vec3,
    /// The simulated equilibrium.
    pub solution: Solution,
    /// Nodes of the skin that are compared.
    pub active: Vec<u32>,
    /// Signed distance (mm) of each active node to the measured skin, positive outside of it.
    pub signed_mm: Vec<f64>,
    /// Distances between simulated and measured skin, or [`Distances::NONE`].
    pub distances: Distances,
}

impl PoseFit {
    /// Writes into a group.
    pub fn put(&self, file: &mut hdf5::Writer, group: &str) -> Result<(), Failure> {
        file.put(&format!("{group}/gravity"), &[self.gravity], "1", "direction of gravity")?;
        file.put_solution(&format!("{group}/solution"), &self.solution)?;
        file.put(&format!("{group}/active"), &self.active, "1", "compared skin nodes")?;
        let name = format!("{group}/signed_distance");
        file.put(&name, &self.signed_mm, "mm", "signed distance to the measured skin")?;
        file.put_json(&format!("{group}/distances"), &self.distances, "distance measures (mm)")?;
        Ok(())
    }

    /// Reads what [`PoseFit::put`] wrote.
    pub fn get(file: &hdf5::Reader, group: &str, pose: &str) -> Result<Self, Failure> {
        let gravity: Vec<Vec3> = file.get(&format!("{group}/gravity"))?;
        Ok(Self {
            pose: pose.into(),
            gravity: gravity.first().copied().unwrap_or_else(Vec3::zeros),
            solution: file.solution(&format!("{group}/solution"))?,
            active: file.get(&format!("{group}/active"))?,
            signed_mm: file.get(&format!("{group}/signed_distance"))?,
            distances: file.json(&format!("{group}/distances"))?,
        })
    }
}

impl PoseTarget {
    /// Brings the measured surfaces of a pose into the reference pose's frame.
    pub fn new(
        pose: &str,
        mesh: &BreastMesh,
        registered: &Registered,
        surfaces: &PoseSurfaces,
    ) -> Result<Self, Failure> {
        let points = surfaces.skin.points.iter().map(|p| registered.transform.point(p)).collect();
        let skin = TriMesh { points, triangles: surfaces.skin.triangles.clone() };
        // A scanner sees no chest wall, and perhaps not all of the skin.
        if surfaces.chest_wall.triangles.is_empty() {
            scan::covers(pose, &skin, &mesh.anatomy)?;
        }
        let index = SurfaceIndex::new(&skin)
            .map_err(|cause| Failure::BadInput(format!("{pose}: measured skin: {cause}")))?;
        let (gravity, motion) = (registered.gravity, registered.transform);
        Ok(Self::of(pose, gravity, motion, Arc::new(MeasuredSkin { skin, index }), mesh))
    }

    /// The same measured surface for another mesh of the body.
    pub fn on(&self, mesh: &BreastMesh) -> Self {
        Self::of(&self.pose, self.gravity, self.motion, self.measured.clone(), mesh)
    }

    fn of(
        pose: &str,
        gravity: Vec3,
        motion: RigidTransform,
        measured: Arc<MeasuredSkin>,
        mesh: &BreastMesh,
    ) -> Self {
        let cuts: Vec<Vec3> =
            [Patch::Superior, Patch::Inferior, Patch::LateralRight, Patch::LateralLeft]
                .iter()
                .flat_map(|&cut| mesh.mesh.patch_nodes(cut))
                .map(|n| mesh.mesh.points[n as usize])
                .collect();
        let mut active = Vec::new();
        let mut sides = Vec::new();
        for n in mesh.mesh.patch_nodes(Patch::Skin) {
            let p = mesh.mesh.points[n as usize];
            let Some((base, radius)) = mesh.anatomy.nearest(&p) else { continue };
            let near_cut = || cuts.iter().any(|c| (c - p).norm() < CUT_MARGIN_MM);
            if radius < ACTIVE_RADIUS && !near_cut() {
                active.push(n);
                sides.push(base.side);
            }
        }
        let faces = mesh.mesh.patch(Patch::Skin).to_vec();
        Self { pose: pose.into(), gravity, motion, measured, faces, active, sides }
    }

    /// Side of each node that is compared.
    pub fn sides(&self) -> &[Side] {
        &self.sides
    }

    /// The nodes that are compared, in the reference pose.
    pub fn reference_shape(&self, mesh: &BreastMesh) -> Shape {
        let points = mesh.mesh.points.clone();
        Shape::of(&TriMesh { points, triangles: self.faces.clone() }, &self.active)
    }

    /// Signed distances (mm) of points to the measured skin, positive outside of it.
    ///
    /// # Errors
    /// [`Failure::Numerics`] at a point that is not finite.
    pub fn signed_mm(&self, points: &[Vec3]) -> Result<Vec<f64>, Failure> {
        let closest = self.measured.index.closest_of(points);
        let closest = closest.map_err(|c| Failure::Numerics(format!("{}: {c}", self.pose)))?;
        Ok(closest.iter().zip(points).map(|(c, p)| c.signed_mm(p)).collect())
    }

    /// Where the compared nodes of a simulated body (mm) belong on the measured skin: it is carried there as smoothly as it can.
    ///
    /// # Errors
    /// [`Failure::Numerics`] at a node that is not finite, or where no skin is compared.
    pub fn corresponding(&self, points: &[Vec3]) -> Result<Vec<(u32, Vec3)>, Failure> {
        let wrong = |cause| Failure::Numerics(format!("{}: {cause}", self.pose));
        let active: BTreeSet<u32> = self.active.iter().copied().collect();
        let whole = |face: &&[u32; 3]| face.iter().all(|n| active.contains(n));
        let triangles = self.faces.iter().filter(whole).copied().collect();
        let skin = TriMesh { points: points.to_vec(), triangles };
        let at: Vec<Vec3> = self.active.iter().map(|&n| points[n as usize]).collect();
        let far = self.signed_mm(&at)?.into_iter().fold(0.0, |far: f64, mm| far.max(mm.abs()));
        let edge = 2.0 * far + RIM_MM;
        let none = Vec3::repeat(f64::INFINITY);
        let low = at.iter().fold(none, |a, b| a.inf(b)).add_scalar(-edge);
        let high = at.iter().fold(-none, |a, b| a.sup(b)).add_scalar(edge);
        let measured = &self.measured.skin;
        let near = |n: &u32| {
            let p = &measured.points[*n as usize];
            (0..3).all(|axis| low[axis] <= p[axis] && p[axis] <= high[axis])
        };
        let near = |face: &&[u32; 3]| face.iter().any(near);
        let triangles = measured.triangles.iter().filter(near).copied().collect();
        let measured = TriMesh { points: measured.points.clone(), triangles };
        let found = Correspondence::new(&skin, &measured, &[]).map_err(wrong)?;
        Ok(self.active.iter().zip(&at).map(|(&n, p)| (n, found.carry(p).0)).collect())
    }

    /// The nodes that are compared, in a simulated pose.
    pub fn shape(&self, fit: &PoseFit) -> Shape {
        let points = fit.solution.points.clone();
        Shape::of(&TriMesh { points, triangles: self.faces.clone() }, &self.active)
    }

    /// Loads a stress-free body into this pose; `start` is where Newton begins, `near` says that it is near to the equilibrium.
    pub fn load(
        &self,
        body: &Body,
        rest: &[Vec3],
        moduli: Moduli,
        start: &[Vec3],
        near: bool,
    ) -> Result<Solution, Failure> {
        let mut model = body.model(rest, moduli, self.gravity, None)?;
        body.keep_off_arms(&mut model, &self.pose, &self.motion)?;
        let from = if near { solve_near } else { solve };
        let solution = from(&model, start, &Options::default(), &Silent)
            .map_err(|cause| Failure::Numerics(format!("{}: {cause}", self.pose)))?;
        Ok(body.spread(solution))
    }

    /// Compares a simulated body with what was measured.
    ///
    /// # Errors
    /// [`Failure::Numerics`] at a node that is not finite.
    pub fn measure(&self, solution: Solution) -> Result<PoseFit, Failure> {
        let mut fit = self.facing(solution)?;
        self.compare(&mut fit)?;
        Ok(fit)
    }

    /// A simulated body with the signed distances of its nodes alone.
    ///
    /// # Errors
    /// As [`PoseTarget::measure`].
    pub fn facing(&self, solution: Solution) -> Result<PoseFit, Failure> {
        let at: Vec<Vec3> = self.active.iter().map(|&n| solution.points[n as usize]).collect();
        Ok(PoseFit {
            pose: self.pose.clone(),
            gravity: self.gravity,
            signed_mm: self.signed_mm(&at)?,
            active: self.active.clone(),
            solution,
            distances: Distances::NONE,
        })
    }

    /// Finds the distances of both skins, which takes longer than all signed ones: a measured skin has ten times the nodes.
    ///
    /// # Errors
    /// As [`PoseTarget::measure`].
    pub fn compare(&self, fit: &mut PoseFit) -> Result<(), Failure> {
        let away = fit.signed_mm.iter().map(|signed| signed.abs()).collect();
        let back = self.distances_back(&fit.solution.points);
        let distances = back.and_then(|back| Distances::of(away, &back));
        fit.distances =
            distances.map_err(|cause| Failure::Numerics(format!("{}: {cause}", self.pose)))?;
        Ok(())
    }

    /// Distances (mm) to the simulated skin of those measured nodes whose nearest simulated point is
    /// among the compared ones.
    fn distances_back(&self, points: &[Vec3]) -> Result<Vec<f64>, DistanceError> {
        let mut is_active = vec![false; points.len()];
        for &n in &self.active {
            is_active[n as usize] = true;
        }
        let active = |n: &u32| is_active[*n as usize];
        let core = self.faces.iter().filter(|face| face.iter().all(active)).copied().collect();
        let core = SurfaceIndex::new(&TriMesh { points: points.to_vec(), triangles: core })?;
        let whole =
            SurfaceIndex::new(&TriMesh { points: points.to_vec(), triangles: self.faces.clone() })?;
        let nearest = whole.closest_of(&self.measured.skin.points)?;
        let compared = |(found, p): (&Closest, &Vec3)| {
            let face = &self.faces[found.triangle];
            // On the rim of the compared skin the nearest point is on a face of either kind.
            let takes_part = face.iter().all(active)
                || face.iter().any(active)
                    && core.closest(p).is_some_and(|c| c.distance_mm <= found.distance_mm + 1e-9);
            takes_part.then_some(found.distance_mm)
        };
        Ok(nearest.iter().zip(&self.measured.skin.points).filter_map(compared).collect())
    }

    /// Mean signed distance (mm) of the skin of one breast, weighted by how far it faces along
    /// gravity: positive when the simulated breast sags too far.
    pub fn sag_residual_mm(&self, fit: &PoseFit, side: Side) -> f64 {
        let surface =
            TriMesh { points: fit.solution.points.clone(), triangles: self.faces.clone() };
        let normals = surface.vertex_normals();
        let (mut sum, mut weights) = (0.0, 0.0);
        for ((&n, &on), signed) in self.active.iter().zip(&self.sides).zip(&fit.signed_mm) {
            let weight = normals[n as usize].dot(&self.gravity).max(0.0);
            if on == side {
                sum += weight * signed;
                weights += weight;
            }
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }
}
