//! What a model is to be made of: tissue, sheets and tethers as plain numbers, before they become
//! terms. Effects change a recipe.

use super::anatomy::Anatomy;
use super::ligaments::{CablePlan, LENGTH_MM, Ligament, cables};
use super::{LawOverride, MEMBRANE_POISSON, Moduli};
use crate::effects::{self, Scene};
use mammotwin_data::{
    Failure, Vec3,
    labels::{Side, Tissue},
    mesh::{Patch, TetMesh},
    study::{InterfacePlan, LawConstants, LawName, LayerPlan, ModelPlan},
};
use mammotwin_solver::{
    materials::{Law, LawError},
    terms::Cable,
};

/// Tissue of one element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissuePlan {
    /// Constitutive law.
    pub law: LawName,
    /// Young's modulus (kPa).
    pub young_kpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Jₘ of the Gent law.
    pub jm: Option<f64>,
    /// Constants of the other laws.
    pub constants: LawConstants,
}

impl TissuePlan {
    /// Adds `amount` to 1/Jₘ: neo-Hookean tissue becomes a Gent one. Laws that limit the stretch
    /// in another way stay as they are.
    pub fn limit_stretch(&mut self, amount: f64) {
        let before = match self.law {
            LawName::NeoHookean => 0.0,
            LawName::Gent => self.jm.map_or(0.0, f64::recip),
            _ => return,
        };
        (self.law, self.jm) = (LawName::Gent, Some((before + amount).recip()));
    }

    fn law(&self) -> Result<Law, LawError> {
        Law::with_constants(self.law, self.young_kpa, self.poisson, self.jm, &self.constants)
    }
}

/// One triangle of a membrane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetPlan {
    /// Its tissue.
    pub tissue: TissuePlan,
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Its centre in the reference pose (mm).
    pub center: Vec3,
}

/// One cable of a ligament.
#[derive(Debug, Clone, PartialEq)]
pub struct Tether {
    /// The ligament that it belongs to.
    pub ligament: Ligament,
    /// Where it is.
    pub cable: CablePlan,
    /// Young's modulus (kPa).
    pub stiffness: f64,
    /// How much longer (mm) it is at rest than the way that it spans.
    pub slack_mm: f64,
}

/// All numbers of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// Of each tetrahedron.
    pub tissue: Vec<TissuePlan>,
    /// Of each triangle of the skin.
    pub skin: Vec<SheetPlan>,
    /// Of each triangle of the deep fascia.
    pub fascia: Vec<SheetPlan>,
    /// Suspensory ligaments.
    pub tethers: Vec<Tether>,
    /// Mass density (g/cm³).
    pub density_g_per_cm3: f64,
    /// Unit vector of gravity in the reference pose's frame, or zero.
    pub gravity: Vec3,
    /// Stretch of the skin in the stress-free shape of the whole: 1 where it is at rest too.
    pub skin_stretch: f64,
    /// Young's modulus (kPa) of fibres from the chest wall to the skin; zero for none.
    pub fibres_kpa: f64,
    /// How far (mm) the chest wall behind the breasts stands out beyond that of the reference pose, where they are bonded.
    pub wall_shift_mm: f64,
    /// What happens between breast and muscle.
    pub interface: InterfacePlan,
}

impl Recipe {
    /// The recipe of a body with its effects. Regions are those of the reference pose (the points
    /// of `mesh`); tethers are just taut in the stress-free shape `rest`. `gravity` is a unit vector.
    ///
    /// # Errors
    /// An unknown ligament or effect.
    pub fn new(
        mesh: &TetMesh,
        anatomy: &Anatomy,
        plan: &ModelPlan,
        rest: &[Vec3],
        gravity: Vec3,
        law: Option<LawOverride>,
    ) -> Result<Self, Failure> {
        let breast = law.unwrap_or(LawOverride {
            name: plan.breast.law,
            jm: plan.breast.jm,
            constants: plan.breast.constants,
            poisson: plan.breast.poisson,
        });
        let moduli = Moduli::of(plan);
        let tissue = |tissue: &Tissue| TissuePlan {
            law: breast.name,
            young_kpa: moduli.of_side(tissue.side().unwrap_or(Side::Left)),
            poisson: breast.poisson,
            jm: breast.jm,
            constants: breast.constants,
        };
        let sheet = |layer: &LayerPlan, patch: Patch| -> Vec<SheetPlan> {
            let own = (layer.law, layer.jm, layer.constants);
            let (kind, jm, constants) = law.map_or(own, |l| (l.name, l.jm, l.constants));
            let (young_kpa, poisson) = (layer.young_kpa, MEMBRANE_POISSON);
            let tissue = TissuePlan { law: kind, young_kpa, poisson, jm, constants };
            let center =
                |face: &[u32; 3]| face.iter().map(|&n| mesh.points[n as usize]).sum::<Vec3>() / 3.0;
            let one = |face: &[u32; 3]| SheetPlan {
                tissue,
                thickness_mm: layer.thickness_mm,
                center: center(face),
            };
            mesh.patch(patch).iter().map(one).collect()
        };
        let mut names = Vec::new();
        for name in &plan.ligaments.names {
            names.push(Ligament::from_name(name).ok_or_else(|| {
                Failure::BadInput(format!("model.ligaments.names: no ligament is called {name}"))
            })?);
        }
        let stiffness = plan.ligaments.young_kpa;
        let tether = |(ligament, cable)| Tether { ligament, cable, stiffness, slack_mm: 0.0 };
        let mut recipe = Self {
            tissue: mesh.tissues.iter().map(tissue).collect(),
            skin: sheet(&plan.skin, Patch::Skin),
            fascia: sheet(&plan.fascia, Patch::ChestWall),
            tethers: cables(mesh, rest, anatomy, &names).into_iter().map(tether).collect(),
            density_g_per_cm3: plan.density_g_per_cm3,
            gravity,
            skin_stretch: 1.0,
            fibres_kpa: 0.0,
            wall_shift_mm: 0.0,
            interface: plan.interface.clone(),
        };
        effects::apply(&mut recipe, &plan.effects, &Scene { mesh, anatomy })?;
        Ok(recipe)
    }

    /// The cables of a ligament.
    pub fn tethers_of(&mut self, ligament: Ligament) -> impl Iterator<Item = &mut Tether> {
        self.tethers.iter_mut().filter(move |tether| tether.ligament == ligament)
    }

    /// Skin and fascia: name, faces, patch, and their stretch where the whole is at rest.
    pub(super) fn sheets(&self) -> [(&'static str, &[SheetPlan], Patch, f64); 2] {
        [
            ("skin", &self.skin, Patch::Skin, self.skin_stretch),
            ("fascia", &self.fascia, Patch::ChestWall, 1.0),
        ]
    }

    /// Laws of the tetrahedra.
    pub(super) fn laws(&self) -> Result<Vec<Law>, LawError> {
        self.tissue.iter().map(TissuePlan::law).collect()
    }

    /// Cables of the ligaments at some nodes.
    pub(super) fn cables_of(&self, wanted: impl Fn(u32) -> bool) -> Vec<Cable> {
        let tethers = self.tethers.iter().filter(|t| wanted(t.cable.node));
        tethers.map(|t| tied(&t.cable, t.stiffness, t.slack_mm)).collect()
    }
}

/// Laws and thicknesses (mm) of a sheet.
pub(super) fn of_sheet(sheet: &[SheetPlan]) -> Result<(Vec<Law>, Vec<f64>), LawError> {
    let laws = sheet.iter().map(|face| face.tissue.law()).collect::<Result<_, _>>()?;
    Ok((laws, sheet.iter().map(|face| face.thickness_mm).collect()))
}

/// A cable of a Young's modulus (kPa) that is `slack_mm` longer than its way.
pub(super) fn tied(plan: &CablePlan, young_kpa: f64, slack_mm: f64) -> Cable {
    Cable {
        node: plan.node,
        anchor: plan.anchor,
        natural_mm: LENGTH_MM + slack_mm,
        stiffness_mn_per_mm: young_kpa * plan.section_mm2 / LENGTH_MM,
    }
}
