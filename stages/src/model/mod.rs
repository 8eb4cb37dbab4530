//! What a breast is to the solver: which terms, which supports, on which nodes.
//!
//! The body is known in its reference pose (the pose of the mesh); its stress-free shape is a
//! value that calibration looks for. Ligaments are just taut in the stress-free shape; cut edges
//! hold the body where it is in the reference pose.

mod anatomy;
mod interface;
mod ligaments;
mod recipe;

pub use anatomy::{Anatomy, BreastBase, NoBreast};
pub use ligaments::{CablePlan, LENGTH_MM, Ligament, cables, lateral_cables, region, shared_nodes};
pub use recipe::{Recipe, SheetPlan, Tether, TissuePlan};

use crate::mesh::BreastMesh;
use mammotwin_data::{
    Failure, Vec3,
    labels::Side,
    mesh::{Patch, TetMesh},
    study::{LawConstants, LawName, ModelPlan},
};
use mammotwin_solver::{
    model::Model,
    terms::{Bulk, Cables, Gravity, GridDistance, Membrane, Target},
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Young's moduli of the breasts, the unknowns of the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Moduli {
    /// Right breast (kPa).
    pub right_kpa: f64,
    /// Left breast (kPa).
    pub left_kpa: f64,
}

impl Moduli {
    /// The moduli that a study gives.
    pub fn of(plan: &ModelPlan) -> Self {
        Self { right_kpa: plan.breast.young_right_kpa, left_kpa: plan.breast.young_left_kpa }
    }

    /// Modulus of a side (kPa).
    pub fn of_side(&self, side: Side) -> f64 {
        match side {
            Side::Right => self.right_kpa,
            Side::Left => self.left_kpa,
        }
    }
}

/// One law for breast, skin and fascia alike, in place of the laws of the plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LawOverride {
    /// Constitutive law.
    pub name: LawName,
    /// Jₘ of the Gent law.
    pub jm: Option<f64>,
    /// Constants of the other laws.
    pub constants: LawConstants,
    /// Poisson's ratio.
    pub poisson: f64,
}

/// The body in its reference pose, and what it rests on.
#[derive(Clone)]
pub struct Body<'a> {
    /// Nodes in the reference pose.
    pub mesh: &'a TetMesh,
    /// Chest wall.
    pub wall: Arc<dyn Target>,
    /// Bases of the breasts.
    pub anatomy: &'a Anatomy,
    /// Tissues and supports.
    pub plan: &'a ModelPlan,
}

impl<'a> Body<'a> {
    /// The body of a mesh.
    pub fn new(mesh: &'a BreastMesh, plan: &'a ModelPlan) -> Self {
        let wall = Arc::new(GridDistance::new(&mesh.wall));
        Self { mesh: &mesh.mesh, wall, anatomy: &mesh.anatomy, plan }
    }

    /// The model whose stress-free shape has its nodes at `rest`, under gravity along `gravity`
    /// (unit vector; zero for none).
    ///
    /// # Errors
    /// A plan that no model can be made of.
    pub fn model(
        &self,
        rest: &[Vec3],
        moduli: Moduli,
        gravity: Vec3,
        law: Option<LawOverride>,
    ) -> Result<Model, Failure> {
        let plan = self.plan;
        let refuse = |cause: &dyn std::fmt::Display| Failure::BadInput(format!("model: {cause}"));
        let recipe = Recipe::new(self.mesh, self.anatomy, plan, rest, moduli, gravity, law)?;
        let mesh = TetMesh { points: rest.to_vec(), ..self.mesh.clone() };
        let mut model = Model::new(&mesh);
        let laws = recipe.laws().map_err(|c| refuse(&c))?;
        let breast = Bulk::new("breast", &mesh, laws).map_err(|c| refuse(&c))?;
        model.add(breast).map_err(|c| refuse(&c))?;
        // Smaller at rest everywhere: stretched by the same ratio.
        let skin_rest: Vec<Vec3> = rest.iter().map(|p| p / recipe.skin_stretch).collect();
        for (name, sheet, patch, rest) in [
            ("skin", &recipe.skin, Patch::Skin, &skin_rest[..]),
            ("fascia", &recipe.fascia, Patch::ChestWall, rest),
        ] {
            let (laws, thickness) = recipe::of_sheet(sheet).map_err(|c| refuse(&c))?;
            let faces = self.mesh.patch(patch);
            let membrane =
                Membrane::new(name, rest, faces, &thickness, &laws).map_err(|c| refuse(&c))?;
            model.add(membrane).map_err(|c| refuse(&c))?;
        }
        if recipe.gravity != Vec3::zeros() {
            let density = recipe.density_g_per_cm3;
            let weight = Gravity::new("gravity", &mesh, density, recipe.gravity);
            model.add(weight).map_err(|c| refuse(&c))?;
        }
        self.support(&mut model, rest, &recipe)?;
        Ok(model)
    }

    /// Chest wall, ligaments and cut edges (Mîra 2018, § 3.4).
    fn support(&self, model: &mut Model, rest: &[Vec3], recipe: &Recipe) -> Result<(), Failure> {
        let refuse = |cause: &dyn std::fmt::Display| Failure::BadInput(format!("model: {cause}"));
        interface::support(self, &recipe.interface, model, rest).map_err(|c| refuse(&c))?;
        let young_kpa = self.plan.ligaments.young_kpa;
        let sides = lateral_cables(self.mesh, rest);
        let sides = sides.iter().map(|cable| recipe::tied(cable, young_kpa, 0.0)).collect();
        for (name, cables) in [("ligaments", recipe.cables()), ("lateral_cables", sides)] {
            if !cables.is_empty() {
                let cables = Cables::new(name, cables).map_err(|c| refuse(&c))?;
                model.add(cables).map_err(|c| refuse(&c))?;
            }
        }
        // Skin and fascia go on beyond the cuts: their ends stay there.
        for (layer, axis) in [(Patch::Skin, 1), (Patch::ChestWall, 2)] {
            for cut in [Patch::Superior, Patch::Inferior] {
                for node in shared_nodes(self.mesh, layer, cut) {
                    model.fix(node, axis);
                }
            }
        }
        Ok(())
    }
}

/// Poisson's ratio of membranes: they are incompressible by their kinematics, it has no effect.
const MEMBRANE_POISSON: f64 = 0.49;
