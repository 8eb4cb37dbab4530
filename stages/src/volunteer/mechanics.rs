//! The truth's mechanics: the stress-free torso, meshed unlike any model under test, under
//! gravity in each pose.

use super::{PoseName, Torso, carry::Shapes, study::model_plan};
use crate::model::{Anatomy, Body, Moduli, Quadratic};
use mammotwin_data::{
    Failure, Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
    progress::Progress,
    solution::Solution,
    study::{Elements, MeshPlan, ModelPlan},
    volume::{Grid, Volume},
};
use mammotwin_solver::{
    Options,
    assemble::Analyses,
    mesh::{
        domain::{Domain, PatchDistances},
        lattice::Placement,
        tetrahedralize::{Meshing, tetrahedralize},
    },
    solve,
    terms::GridDistance,
};
use std::sync::Arc;

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

/// How the truth's lattice lies: unlike the usual one.
pub const TRUTH: Placement =
    Placement { rotation: [-0.52, 0.31, 0.77], offset: [0.71, 0.05, 0.57] };

/// Meshes the stress-free soft tissue with edges of `size_mm`, on a lattice that lies unlike the
/// usual one.
///
/// # Errors
/// [`Failure::Numerics`] when the torso cannot be meshed at this size.
pub fn stress_free_mesh(torso: &Torso, size_mm: f64) -> Result<TetMesh, Failure> {
    on_lattice(torso, size_mm, TRUTH)
}

fn on_lattice(torso: &Torso, size_mm: f64, placement: Placement) -> Result<TetMesh, Failure> {
    let side = |p: &Vec3| if p.x > 0.0 { Tissue::AdiposeRight } else { Tissue::AdiposeLeft };
    tetrahedralize(torso, &Meshing { size_mm, placement }, side)
        .map_err(|cause| Failure::Numerics(format!("truth mesh: {cause}")))
}

/// The stress-free body, and the supine one to which supports are tied.
pub struct TruthBody {
    /// Stress-free; the parts of its elements where these are quadratic.
    pub mesh: TetMesh,
    /// Equilibrium in the supine pose.
    pub supine: Solution,
    supine_mesh: TetMesh,
    quadratic: Option<Quadratic>,
    anatomy: Anatomy,
    wall: Arc<GridDistance>,
    plan: ModelPlan,
    moduli: Moduli,
    analyses: Analyses,
}

/// Spacing (mm) of the samples of the chest wall's distance.
const WALL_SPACING_MM: f64 = 3.0;

impl TruthBody {
    /// Meshes the stress-free torso and lays it on its back.
    ///
    /// Ligaments and lateral cables are just taut in the supine pose: they do not pull there, and
    /// that equilibrium is found without them.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when there is no mesh or no equilibrium.
    pub fn new(torso: &Torso, meshing: MeshPlan, progress: &dyn Progress) -> Result<Self, Failure> {
        Self::on_lattice(torso, meshing, TRUTH, progress)
    }

    /// The same on a lattice of one's own choice.
    ///
    /// # Errors
    /// As [`TruthBody::new`].
    pub fn on_lattice(
        torso: &Torso,
        meshing: MeshPlan,
        placement: Placement,
        progress: &dyn Progress,
    ) -> Result<Self, Failure> {
        let mesh = on_lattice(torso, meshing.size_mm, placement)?;
        let (mesh, quadratic) = match meshing.elements {
            Elements::Linear => (mesh, None),
            Elements::Quadratic => {
                let (quadratic, parts) = Quadratic::fitted(mesh, torso);
                (parts, Some(quadratic))
            }
        };
        let (low, high) = torso.bounds();
        let [low, high] = [low.add_scalar(-30.0), high.add_scalar(10.0)];
        let count = |axis: usize| ((high[axis] - low[axis]) / WALL_SPACING_MM) as usize + 2;
        let grid = Grid::aligned([count(0), count(1), count(2)], [WALL_SPACING_MM; 3], low);
        let sample = |n: usize| torso.chest_wall(&grid.center(grid.voxel(n))) as f32;
        let values = (0..grid.len()).map(sample).collect();
        let wall = Arc::new(GridDistance::new(&Volume { grid, values }));
        let plan = model_plan(&torso.person);
        let moduli = Moduli::of(&plan);
        let anatomy = |mesh: &TetMesh| {
            Anatomy::of(mesh, 0.0).map_err(|cause| Failure::Numerics(format!("truth: {cause}")))
        };

        let mut free = mesh.clone();
        free.patches.remove(&Patch::LateralRight);
        free.patches.remove(&Patch::LateralLeft);
        let mut untied = plan.clone();
        untied.ligaments.names.clear();
        let lying = Body {
            mesh: &free,
            wall: wall.clone(),
            anatomy: &anatomy(&mesh)?,
            plan: &untied,
            quadratic: quadratic.as_ref(),
            muscle: None,
            analyses: Analyses::default(),
        };
        let model = lying.model(&mesh.points, moduli, PoseName::Supine.gravity(), None)?;
        let supine = solve(&model, &mesh.points, &Options::default(), progress)
            .map_err(|cause| Failure::Numerics(format!("truth, supine: {cause}")))?;
        let supine = lying.spread(supine);
        let supine_mesh = TetMesh { points: supine.points.clone(), ..mesh.clone() };
        let anatomy = anatomy(&supine_mesh)?;
        let quadratic = quadratic.map(|quadratic| quadratic.with_points(&supine.points));
        let analyses = Analyses::default();
        Ok(Self { mesh, supine, supine_mesh, quadratic, anatomy, wall, plan, moduli, analyses })
    }

    /// The moduli of the truth.
    pub fn moduli(&self) -> Moduli {
        self.moduli
    }

    /// The supine body with the tissues and supports of `plan`.
    pub fn body<'a>(&'a self, plan: &'a ModelPlan) -> Body<'a> {
        let (mesh, anatomy) = (&self.supine_mesh, &self.anatomy);
        let (quadratic, muscle) = (self.quadratic.as_ref(), None);
        let analyses = self.analyses.clone();
        Body { mesh, wall: self.wall.clone(), anatomy, plan, quadratic, muscle, analyses }
    }

    /// The equilibrium in a pose, in the common frame.
    ///
    /// # Errors
    /// [`Failure::Numerics`] when there is none.
    pub fn deform(&self, pose: PoseName, progress: &dyn Progress) -> Result<Solution, Failure> {
        if pose == PoseName::Supine {
            return Ok(self.supine.clone());
        }
        let body = self.body(&self.plan);
        let rest = &self.mesh.points;
        let model = body.model(rest, self.moduli, pose.gravity(), None)?;
        // Poses in which gravity presses on the chest are nearer to the supine one.
        let pressed = pose.gravity().dot(&PoseName::Supine.gravity()) > 0.0;
        let start = if pressed { &self.supine.points } else { rest };
        let solution = solve(&model, start, &Options::default(), progress)
            .map_err(|cause| Failure::Numerics(format!("truth, {}: {cause}", pose.name())))?;
        Ok(body.spread(solution))
    }

    /// Stress-free and deformed shape.
    pub fn shapes<'a>(&'a self, deformed: &'a Solution) -> Shapes<'a> {
        Shapes { tets: &self.mesh.tets, rest: &self.mesh.points, deformed: &deformed.points }
    }
}
