//! The library of physical effects that a model may lack.
//!
//! An effect changes the [`Recipe`] of a body by an amplitude; amplitude zero is the model without
//! it, and small amplitudes change the model in proportion. A new effect is one file here and one
//! line in [`EFFECTS`].

mod bond_region;
mod compressible;
mod cooper_anisotropy;
mod cranial_ligament;
mod density;
mod fascia_limit;
mod friction;
mod gland_inclusion;
mod gravity_dir;
mod inframammary_slack;
mod lateral_ligament;
mod left_right;
mod limit_chain;
mod pectoral_shift;
mod skin_limit;
mod skin_prestress;
mod skin_region;
mod skin_thickness;
mod viscosity;

use crate::model::{Anatomy, Ligament, Recipe, Tether};
use mammotwin_data::{Failure, Vec3, mesh::TetMesh};
use std::collections::BTreeMap;

/// All effects, in the order in which they are listed. The study's reader knows their names as
/// [`mammotwin_data::study::EFFECTS`]; a test keeps the two alike.
pub const EFFECTS: [&Effect; 19] = [
    &limit_chain::EFFECT,
    &fascia_limit::EFFECT,
    &cranial_ligament::EFFECT,
    &lateral_ligament::EFFECT,
    &inframammary_slack::EFFECT,
    &skin_region::EFFECT,
    &skin_thickness::EFFECT,
    &skin_prestress::EFFECT,
    &skin_limit::EFFECT,
    &gland_inclusion::EFFECT,
    &compressible::EFFECT,
    &cooper_anisotropy::EFFECT,
    &friction::EFFECT,
    &bond_region::EFFECT,
    &left_right::EFFECT,
    &gravity_dir::EFFECT,
    &pectoral_shift::EFFECT,
    &viscosity::EFFECT,
    &density::EFFECT,
];

/// A physical effect: what it is to people, and what it does to a model.
#[derive(Debug)]
pub struct Effect {
    /// Word in study files.
    pub name: &'static str,
    /// What people call it.
    pub title: &'static str,
    /// Where it acts.
    pub place: &'static str,
    /// What its number means.
    pub amplitude: Amplitude,
    /// One sentence for the report.
    pub sentence: &'static str,
    /// What shows it, and what tells it from others.
    pub signature: &'static str,
    /// Effects that look alike.
    pub confused_with: &'static [&'static str],
    /// What measurement would tell them apart.
    pub separated_by: &'static str,
    apply: fn(&mut Recipe, f64, &Scene),
}

/// The number of an effect; zero is the model without it.
#[derive(Debug, Clone, Copy)]
pub struct Amplitude {
    /// What it is, e.g. `1/Jₘ of the breast`.
    pub meaning: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Plausible range.
    pub range: [f64; 2],
    /// A small amplitude, for differences.
    pub small: f64,
}

/// The body that a recipe is for, in its reference pose.
pub struct Scene<'a> {
    /// Its mesh.
    pub mesh: &'a TetMesh,
    /// Bases of its breasts.
    pub anatomy: &'a Anatomy,
}

impl Effect {
    /// The effect of a word.
    pub fn named(name: &str) -> Option<&'static Self> {
        EFFECTS.into_iter().find(|effect| effect.name == name)
    }
}

/// Changes a recipe by all effects of a study (`model.effects`: amplitude by name).
///
/// # Errors
/// [`Failure::BadInput`] for a name that is not in the library, or an amplitude outside the
/// plausible range.
pub fn apply(
    recipe: &mut Recipe,
    effects: &BTreeMap<String, f64>,
    scene: &Scene,
) -> Result<(), Failure> {
    for (name, &amplitude) in effects {
        let refuse = |why: String| Failure::BadInput(format!("model.effects.{name}: {why}"));
        let effect = Effect::named(name)
            .ok_or_else(|| refuse("no such effect; `mammotwin effects` lists them".into()))?;
        let [least, greatest] = effect.amplitude.range;
        if !(least..=greatest).contains(&amplitude) {
            let unit = effect.amplitude.unit;
            return Err(refuse(format!(
                "{amplitude} is outside the plausible range {least} to {greatest} {unit}"
            )));
        }
        if amplitude != 0.0 {
            (effect.apply)(recipe, amplitude, scene);
        }
    }
    Ok(())
}

/// Gravity that points forwards by more than this is that of a person on her front.
const ON_THE_FRONT: f64 = 0.7;

/// Whether a recipe is that of a person on her front.
fn on_the_front(recipe: &Recipe) -> bool {
    recipe.gravity.y > ON_THE_FRONT
}

/// Multiplies the stiffness of one ligament.
fn stiffen(recipe: &mut Recipe, ligament: Ligament, factor: f64) {
    for Tether { stiffness, .. } in recipe.tethers_of(ligament) {
        *stiffness *= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::TissuePlan;
    use mammotwin_data::study::{
        InterfaceKind, InterfacePlan, InterfaceRegion, LawConstants, LawName,
    };

    #[test]
    fn the_reader_of_studies_knows_the_same_effects() {
        assert_eq!(EFFECTS.map(|effect| effect.name), mammotwin_data::study::EFFECTS);
    }

    #[test]
    fn ranges_hold_zero_and_the_small_amplitude_and_rivals_exist() {
        for effect in EFFECTS {
            let Amplitude { range: [least, greatest], small, .. } = effect.amplitude;
            assert!(least <= 0.0 && small > 0.0 && small < 0.5 * greatest, "{}", effect.name);
            for rival in effect.confused_with {
                assert!(Effect::named(rival).is_some(), "{}: {rival}", effect.name);
                assert_ne!(*rival, effect.name);
            }
        }
    }

    fn fat() -> TissuePlan {
        let (law, constants) = (LawName::NeoHookean, LawConstants::default());
        TissuePlan { law, young_kpa: 0.5, poisson: 0.49, jm: None, constants }
    }

    /// Applies one effect to a recipe of one element.
    fn with(name: &str, amplitude: f64, kind: InterfaceKind, gravity: Vec3) -> Recipe {
        let mut recipe = Recipe {
            tissue: vec![fat()],
            skin: Vec::new(),
            fascia: Vec::new(),
            tethers: Vec::new(),
            density_g_per_cm3: 1.0,
            gravity,
            skin_stretch: 1.0,
            fibres_kpa: 0.0,
            wall_shift_mm: 0.0,
            interface: InterfacePlan::uniform(kind, Some(0.1)),
        };
        let anatomy = Anatomy { sternum_x_mm: 0.0, breasts: Vec::new() };
        let scene = Scene { mesh: &TetMesh::default(), anatomy: &anatomy };
        apply(&mut recipe, &BTreeMap::from([(name.to_string(), amplitude)]), &scene).unwrap();
        recipe
    }

    #[test]
    fn friction_holds_what_slides_and_a_region_may_hold_more() {
        let everywhere = with("friction", 0.2, InterfaceKind::NoSeparation, Vec3::z()).interface;
        let region = InterfaceRegion::Cranial;
        assert!((everywhere.of(None).coefficient() - 0.3).abs() < 1e-12);
        assert!((everywhere.of(Some(region)).coefficient() - 0.3).abs() < 1e-12);
        let there = with("bond_region", 0.5, InterfaceKind::NoSeparation, Vec3::z()).interface;
        assert!((there.of(Some(region)).coefficient() - 0.6).abs() < 1e-12);
        assert_eq!(there.of(None).coefficient(), 0.1);
        for name in ["friction", "bond_region"] {
            assert!(with(name, 0.3, InterfaceKind::Bonded, Vec3::z()).interface.is_bonded());
        }
    }

    #[test]
    fn gravity_turns_for_a_person_on_her_front_alone() {
        let of = |gravity| with("gravity_dir", 6.0, InterfaceKind::Bonded, gravity).gravity;
        let turned = of(Vec3::y());
        assert!((turned.angle(&Vec3::y()).to_degrees() - 6.0).abs() < 1e-9);
        assert!(turned.z == 0.0 && (turned.norm() - 1.0).abs() < 1e-12);
        for gravity in [-Vec3::y(), -Vec3::z(), Vec3::new(-0.74, -0.67, 0.0).normalize()] {
            assert_eq!(of(gravity), gravity);
        }
    }

    #[test]
    fn creep_and_moved_muscle_are_those_of_a_person_on_her_front() {
        let of = |name, gravity| with(name, 0.5, InterfaceKind::Bonded, gravity);
        assert_eq!(of("pectoral_shift", Vec3::y()).wall_shift_mm, 0.5);
        assert_eq!(of("pectoral_shift", -Vec3::y()).wall_shift_mm, 0.0);
        assert_eq!(of("viscosity", Vec3::y()).tissue[0].young_kpa, 0.75);
        assert_eq!(of("viscosity", -Vec3::z()).tissue[0].young_kpa, 0.5);
        assert_eq!(of("cooper_anisotropy", -Vec3::z()).fibres_kpa, 0.25);
    }

    #[test]
    fn prestressed_skin_is_stretched_at_rest() {
        let recipe = with("skin_prestress", 0.1, InterfaceKind::Bonded, Vec3::z());
        assert_eq!(recipe.skin_stretch, 1.1);
    }
}
