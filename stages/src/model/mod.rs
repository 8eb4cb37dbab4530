//! What a breast is to the solver: which terms, which supports, on which nodes.
//!
//! The body is known in its reference pose (the pose of the mesh); its stress-free shape is a
//! value that calibration looks for. Ligaments are just taut in the stress-free shape; cut edges
//! hold the body where it is in the reference pose.

mod anatomy;
mod interface;
mod ligaments;
mod moduli;
mod muscle;
mod quadratic;
mod recipe;

pub use anatomy::{Anatomy, BreastBase, NoBreast};
pub use ligaments::{CablePlan, LENGTH_MM, Ligament, cables, lateral_cables, region, shared_nodes};
pub use moduli::{Moduli, Shared};
pub use muscle::{LAYERS, Muscle, THINNEST_MM};
pub use quadratic::Quadratic;
pub use recipe::{Recipe, SheetPlan, Tether, TissuePlan};

use crate::mesh::BreastMesh;
use mammotwin_data::{
    Failure, Vec3,
    mesh::{Patch, TetMesh},
    rigid::RigidTransform,
    solution::Solution,
    study::{InterfaceKind, InterfacePlan, LawConstants, LawName, ModelPlan},
};
use mammotwin_solver::{
    assemble::Analyses,
    materials::LawError,
    model::{Model, ModelError},
    terms::{
        Bulk, Cables, Fibres, Gravity, GridDistance, Membrane, Opening, SelfContact, Sliding,
        Target, target::Capsule,
    },
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

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
    /// Quadratic elements on the nodes of `mesh`, whose tetrahedra are their parts; without it the
    /// tetrahedra of `mesh` are the elements.
    pub quadratic: Option<&'a Quadratic>,
    /// Muscle behind the breast, on the last nodes of `mesh`; without it the chest wall is rigid.
    pub muscle: Option<&'a Muscle>,
    /// What its models have in common: their elements.
    pub analyses: Analyses,
}

impl<'a> Body<'a> {
    /// The body of a mesh.
    pub fn new(mesh: &'a BreastMesh, plan: &'a ModelPlan) -> Self {
        let wall = Arc::new(GridDistance::new(&mesh.wall));
        Self {
            mesh: &mesh.mesh,
            wall,
            anatomy: &mesh.anatomy,
            plan,
            quadratic: mesh.quadratic.as_ref(),
            muscle: mesh.muscle.as_ref(),
            analyses: Analyses::default(),
        }
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
        if !self.plan.muscle.rigid && self.muscle.is_none() {
            return Err(Failure::BadInput(NO_MUSCLE.into()));
        }
        let plan = &moduli.applied(self.plan);
        Body { plan, ..self.clone() }.build(rest, gravity, law)
    }

    /// The same with the moduli of the plan.
    fn build(
        &self,
        rest: &[Vec3],
        gravity: Vec3,
        law: Option<LawOverride>,
    ) -> Result<Model, Failure> {
        let plan = self.plan;
        let elements = self.quadratic.map_or(self.mesh, |quadratic| &quadratic.parents);
        let recipe = Recipe::new(elements, self.anatomy, plan, rest, gravity, law)?;
        let mut model = Model::new(&TetMesh { points: rest.to_vec(), ..TetMesh::default() });
        model.share(&self.analyses);
        match self.quadratic {
            None => self.linear(&mut model, rest, &recipe),
            Some(quadratic) => quadratic.tissues(&mut model, rest, &recipe),
        }
        .map_err(|cause| Failure::BadInput(format!("model: {cause}")))?;
        if recipe.fibres_kpa > 0.0 {
            let fibres = self.fibres(rest, recipe.fibres_kpa);
            fibres
                .and_then(|fibres| model.add(fibres))
                .map_err(|cause| Failure::BadInput(format!("model: {cause}")))?;
        }
        if let Some(muscle) = self.muscle {
            muscle
                .add(&mut model, self, &recipe, rest)
                .map_err(|cause| Failure::BadInput(format!("model: {cause}")))?;
        }
        self.support(&mut model, rest, &recipe)?;
        Ok(model)
    }

    /// Whether a node of the breast's rear is glued to what is behind it.
    fn is_bonded(&self, plan: &InterfacePlan, node: u32) -> bool {
        plan.of(interface::part(self, plan, node)).kind == InterfaceKind::Bonded
    }

    /// Gives the nodes of the muscle's own front what the breast's nodes have (mm) to which they are glued.
    pub fn join(&self, of_nodes: &mut [Vec3]) {
        if let Some(muscle) = self.muscle {
            muscle.follow(of_nodes, |node| self.is_bonded(&self.plan.interface, node));
        }
    }

    /// A solution of this body's model with its fields on the tetrahedra of the mesh.
    pub fn spread(&self, mut solution: Solution) -> Solution {
        self.join(&mut solution.points);
        match self.quadratic {
            Some(quadratic) => quadratic.spread(solution),
            None => solution,
        }
    }

    /// Tissue, sheets and weight on linear elements.
    fn linear(&self, model: &mut Model, rest: &[Vec3], recipe: &Recipe) -> Result<(), TissueError> {
        let mesh = TetMesh { points: rest.to_vec(), ..self.mesh.clone() };
        model.add(Bulk::new("breast", &mesh, recipe.laws()?)?)?;
        for (name, sheet, patch, stretch) in recipe.sheets() {
            let rest = relaxed(rest, stretch);
            let (laws, thickness_mm) = recipe::of_sheet(sheet)?;
            let faces = self.mesh.patch(patch);
            model.add(Membrane::new(name, &rest, faces, &thickness_mm, &laws)?)?;
        }
        if recipe.gravity != Vec3::zeros() {
            let density = recipe.density_g_per_cm3;
            model.add(Gravity::new("gravity", &mesh, density, recipe.gravity))?;
        }
        Ok(())
    }

    /// Keeps the skin off the arms of a pose, without friction; `motion` brings its image into the reference pose's frame.
    ///
    /// # Errors
    /// An arm that no term can be made of.
    pub fn keep_off_arms(
        &self,
        model: &mut Model,
        pose: &str,
        motion: &RigidTransform,
    ) -> Result<(), Failure> {
        let skin = self.mesh.patch(Patch::Skin);
        for (n, arm) in self.plan.arms.get(pose).into_iter().flatten().enumerate() {
            let ends = [arm.from_mm, arm.to_mm].map(|end| motion.point(&end.into()));
            let arm = Arc::new(Capsule { ends, radius_mm: arm.radius_mm });
            let contact = Sliding::new(&format!("arm_{}", n + 1), &self.mesh.points, skin, arm);
            model
                .add(contact.opening(Opening::Free))
                .map_err(|cause| Failure::BadInput(format!("model.arms.{pose}: {cause}")))?;
        }
        Ok(())
    }

    /// Fibres along the normal of the nearest breast's base; quadratic elements have them in their parts.
    fn fibres(&self, rest: &[Vec3], young_kpa: f64) -> Result<Fibres, ModelError> {
        let direction = |tet: &[u32; 4]| {
            let center = tet.iter().map(|&n| self.mesh.points[n as usize]).sum::<Vec3>() / 4.0;
            self.anatomy.nearest(&center).map_or(Vec3::y(), |(base, _)| base.normal)
        };
        let directions: Vec<Vec3> = self.mesh.tets.iter().map(direction).collect();
        let mesh = TetMesh { points: rest.to_vec(), ..self.mesh.clone() };
        Fibres::new("fibres", &mesh, &directions, young_kpa)
    }

    /// Chest wall, ligaments and cut edges (Mîra 2018, § 3.4).
    fn support(&self, model: &mut Model, rest: &[Vec3], recipe: &Recipe) -> Result<(), Failure> {
        let refuse = |cause: &dyn std::fmt::Display| Failure::BadInput(format!("model: {cause}"));
        interface::support(self, recipe, model, rest).map_err(|c| refuse(&c))?;
        let young_kpa = self.plan.ligaments.young_kpa;
        let ligaments = match self.muscle {
            // Both ends of a ligament move with the muscle where the breast is glued to it.
            Some(_) => recipe.cables_of(|node| !self.is_bonded(&recipe.interface, node)),
            None => recipe.cables_of(|_| true),
        };
        let sides = lateral_cables(self.mesh, rest);
        let sides = sides.iter().map(|cable| recipe::tied(cable, young_kpa, 0.0)).collect();
        for (name, cables) in [("ligaments", ligaments), ("lateral_cables", sides)] {
            if !cables.is_empty() {
                let cables = Cables::new(name, cables).map_err(|c| refuse(&c))?;
                model.add(cables).map_err(|c| refuse(&c))?;
            }
        }
        if self.plan.skin_contact {
            let mesh = TetMesh { points: rest.to_vec(), ..self.mesh.clone() };
            let contact = SelfContact::new(SKIN_CONTACT, &mesh, self.mesh.patch(Patch::Skin));
            model.add(contact).map_err(|c| refuse(&c))?;
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

/// Name of the term that keeps skin off skin.
const SKIN_CONTACT: &str = "skin_contact";

/// How deep (mm) skin passes through skin of a body with its nodes at `points` (mm), and the node that is
/// deepest; `None` where none does.
pub fn skin_through_skin(mesh: &TetMesh, points: &[Vec3]) -> Option<(u32, f64)> {
    let contact = SelfContact::new(SKIN_CONTACT, mesh, mesh.patch(Patch::Skin));
    contact.deepest(points).filter(|(_, deep_mm)| *deep_mm > TOLD_MM)
}

/// Skin that is less deep (mm) in other skin is not told: facets of a fold meet so.
const TOLD_MM: f64 = 0.5;

/// Why tissue cannot be modelled.
#[derive(Debug, thiserror::Error)]
enum TissueError {
    #[error(transparent)]
    Law(#[from] LawError),
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Rest positions (mm) of a sheet that is stretched alike everywhere where the whole is at rest.
fn relaxed(rest: &[Vec3], stretch: f64) -> Vec<Vec3> {
    rest.iter().map(|p| p / stretch).collect()
}

/// Said where a plan wants a muscle that was not meshed.
const NO_MUSCLE: &str = "model.muscle.rigid: a deformable muscle is modelled in runs with linear elements alone, not \
     here; set it to true";

/// Poisson's ratio of membranes: they are incompressible by their kinematics, it has no effect.
const MEMBRANE_POISSON: f64 = 0.49;
