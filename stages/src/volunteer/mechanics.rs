//! The truth's mechanics: the stress-free torso, meshed unlike any model under test, under
//! gravity in each pose.

use super::{PoseName, Torso, carry::Shapes};
use mammotwin_data::{
    Failure, Vec3,
    labels::{Side, Tissue},
    mesh::{Patch, TetMesh},
    progress::Progress,
    solution::Solution,
    study::LawName,
};
use mammotwin_solver::{
    Model, Options,
    materials::Law,
    mesh::{
        domain::{Domain, PatchDistances},
        lattice::Placement,
        tetrahedralize::{Meshing, tetrahedralize},
    },
    solve,
    terms::{Bulk, Gravity, Membrane},
};

/// The stress-free torso between the breast limits.
impl Domain for Torso {
    fn distances(&self, p: &Vec3) -> PatchDistances {
        let lateral = self.limits.least_y_mm - p.y;
        let [near, far] = match p.x > 0.0 {
            true => [Patch::LateralRight, Patch::LateralLeft],
            false => [Patch::LateralLeft, Patch::LateralRight],
        };
        PatchDistances::none()
            .with(Patch::Skin, self.smooth_skin(p))
            .with(Patch::ChestWall, -self.chest_wall(p))
            .with(Patch::Superior, p.z - self.limits.greatest_z_mm)
            .with(Patch::Inferior, self.limits.least_z_mm - p.z)
            .with(near, lateral)
            // The other side's half of the midaxillary plane is out of reach.
            .with(far, lateral - p.x.abs())
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        let (chest, breast) = (&self.person.chest, &self.person.breast);
        let over = 1.2 * chest.muscle_thick_mm + breast.projection_mm + chest.fat_mm;
        let limits = &self.limits;
        let low = Vec3::new(-chest.half_axis_x_mm - over, limits.least_y_mm, limits.least_z_mm);
        let high = Vec3::new(
            chest.half_axis_x_mm + over,
            chest.half_axis_y_mm + over,
            limits.greatest_z_mm,
        );
        (low, high)
    }
}

/// Meshes the stress-free soft tissue with edges of `size_mm`, on a lattice that lies unlike the
/// usual one.
///
/// # Errors
/// [`Failure::Numerics`] when the torso cannot be meshed at this size.
pub fn stress_free_mesh(torso: &Torso, size_mm: f64) -> Result<TetMesh, Failure> {
    let placement = Placement { rotation: [-0.52, 0.31, 0.77], offset: [0.71, 0.05, 0.57] };
    let side = |p: &Vec3| if p.x > 0.0 { Tissue::AdiposeRight } else { Tissue::AdiposeLeft };
    tetrahedralize(torso, &Meshing { size_mm, placement }, side)
        .map_err(|cause| Failure::Numerics(format!("truth mesh: {cause}")))
}

/// The body in one pose.
#[derive(Debug, Clone)]
pub struct Deformed {
    /// Which pose.
    pub pose: PoseName,
    /// Its equilibrium, in the common frame.
    pub solution: Solution,
}

impl Deformed {
    /// Stress-free and deformed shape.
    pub fn shapes<'a>(&'a self, mesh: &'a TetMesh) -> Shapes<'a> {
        Shapes { tets: &mesh.tets, rest: &mesh.points, deformed: &self.solution.points }
    }
}

/// Loads the stress-free body with gravity in a pose.
///
/// # Errors
/// [`Failure::Numerics`] when there is no equilibrium.
pub fn deform(
    torso: &Torso,
    mesh: &TetMesh,
    pose: PoseName,
    progress: &dyn Progress,
) -> Result<Deformed, Failure> {
    let model = model(torso, mesh, pose.gravity())?;
    let solution = solve(&model, &mesh.points, &Options::default(), progress)
        .map_err(|cause| Failure::Numerics(format!("{}: {cause}", pose.name())))?;
    Ok(Deformed { pose, solution })
}

fn model(torso: &Torso, mesh: &TetMesh, gravity: Vec3) -> Result<Model, Failure> {
    let refuse = |cause: &dyn std::fmt::Display| Failure::Numerics(format!("truth: {cause}"));
    let (fixed, stiffness) = (&torso.person.fixed, &torso.person.stiffness);
    let law = |young_kpa: f64| {
        Law::new(LawName::NeoHookean, young_kpa, fixed.poisson, None).map_err(|c| refuse(&c))
    };
    let [right, left] = [law(stiffness.breast_right_kpa)?, law(stiffness.breast_left_kpa)?];
    let side = |t: &Tissue| if *t == Tissue::AdiposeRight { Side::Right } else { Side::Left };
    let of = |t: &Tissue| match side(t) {
        Side::Right => right,
        Side::Left => left,
    };
    let laws = mesh.tissues.iter().map(of).collect();
    let mut model = Model::new(mesh);
    model.add(Bulk::new("breast", mesh, laws).map_err(|c| refuse(&c))?).map_err(|c| refuse(&c))?;
    let layers = [
        ("skin", Patch::Skin, stiffness.skin_kpa, fixed.skin_mm),
        ("fascia", Patch::ChestWall, stiffness.fascia_kpa, fixed.fascia_mm),
    ];
    for (name, patch, young_kpa, thickness_mm) in layers {
        let (faces, law) = (mesh.patch(patch), law(young_kpa)?);
        let sheet = Membrane::uniform(name, &mesh.points, faces, thickness_mm, law);
        model.add(sheet.map_err(|c| refuse(&c))?).map_err(|c| refuse(&c))?;
    }
    let weight = Gravity::new("gravity", mesh, fixed.density_g_per_cm3, gravity);
    model.add(weight).map_err(|c| refuse(&c))?;
    for node in mesh.patch_nodes(Patch::ChestWall) {
        model.fix_node(node);
    }
    Ok(model)
}
