//! Round trips of a volunteer's body: supine shape, stress-free shape, supine shape.

use mammotwin_data::{
    progress::Silent,
    study::{Elements, InterfaceKind, InterfacePlan, LayerPlan, MeshPlan, ModelPlan},
};
use mammotwin_solver::unload::{self, Method, stress_free};
use mammotwin_stages::model::Moduli;
use mammotwin_stages::volunteer::{PoseName, Preset, Torso, mechanics::TruthBody, model_plan};

/// Tissues of one round trip.
#[derive(Debug, Clone, Copy)]
struct Tissues {
    breast_kpa: f64,
    skin_kpa: f64,
    fascia_kpa: f64,
    kind: InterfaceKind,
    friction: f64,
}

const SOFT: Tissues = Tissues {
    breast_kpa: 0.2,
    skin_kpa: 4.0,
    fascia_kpa: 120.0,
    kind: InterfaceKind::Bonded,
    friction: 0.0,
};

struct Volunteer {
    body: TruthBody,
    plan: ModelPlan,
}

fn volunteer(preset: &str) -> Volunteer {
    let torso = Torso::new(Preset::named(preset).unwrap(), 1);
    let size_mm = if preset == "tiny" { 13.0 } else { 8.5 };
    let meshing = MeshPlan { size_mm, elements: Elements::Linear };
    let body = TruthBody::new(&torso, meshing, &Silent).unwrap();
    println!("{preset}: {} tetrahedra", body.mesh.tets.len());
    Volunteer { body, plan: model_plan(&torso.person) }
}

/// Finds the stress-free shape of the supine body as if it were of other tissues.
fn unloaded(
    volunteer: &Volunteer,
    tissues: Tissues,
    method: Method,
) -> Result<unload::StressFree, unload::UnloadError> {
    let mut plan = volunteer.plan.clone();
    plan.skin = LayerPlan { young_kpa: tissues.skin_kpa, ..plan.skin };
    plan.fascia = LayerPlan { young_kpa: tissues.fascia_kpa, ..plan.fascia };
    plan.interface = InterfacePlan::uniform(tissues.kind, Some(tissues.friction));
    let moduli = Moduli::new(tissues.breast_kpa, tissues.breast_kpa);
    let body = volunteer.body.body(&plan);
    let build = |rest: &[_]| body.model(rest, moduli, PoseName::Supine.gravity(), None);
    let options = unload::Options { method, ..unload::Options::default() };
    let clock = std::time::Instant::now();
    let supine = &volunteer.body.supine.points;
    let found = stress_free(supine, supine, build, &options, &Silent);
    let time = clock.elapsed();
    match &found {
        Ok(found) => println!(
            "{tissues:?} {method:?}: {:.4} mm rms, {:.3} mm max (off the wall {:.3}), {} equilibria, \
             {:?}, {time:.2?}",
            found.miss.rms_mm,
            found.miss.max_mm,
            found.off_surface_mm,
            found.iterations,
            found.effort
        ),
        Err(error) => println!("{tissues:?} {method:?}: {error}, {time:.2?}"),
    }
    found
}

const KINDS: [InterfaceKind; 2] = [InterfaceKind::Bonded, InterfaceKind::NoSeparation];

#[test]
fn a_soft_supine_body_returns_to_its_shape() {
    let volunteer = volunteer("tiny");
    for kind in KINDS {
        for breast_kpa in [0.2, 0.5] {
            let tissues = Tissues { breast_kpa, kind, ..SOFT };
            let found = unloaded(&volunteer, tissues, Method::Inverse).unwrap();
            assert!(found.miss.rms_mm < 0.05, "{tissues:?}: {:?}", found.miss);
        }
    }
}

#[test]
#[ignore = "minutes: both methods, corners of the box of moduli"]
fn a_supine_body_returns_to_its_shape_in_the_whole_box_of_moduli() {
    let preset = std::env::var("PRESET").unwrap_or_else(|_| "tiny".into());
    let volunteer = volunteer(&preset);
    let mut off = 0;
    for kind in KINDS {
        for breast_kpa in [0.2, 0.3, 0.5, 4.0] {
            for (skin_kpa, fascia_kpa) in [(4.0, 120.0), (2.0, 50.0), (20.0, 250.0)] {
                let tissues = Tissues { breast_kpa, skin_kpa, fascia_kpa, kind, friction: 0.0 };
                let found = unloaded(&volunteer, tissues, Method::Inverse);
                off += usize::from(!found.is_ok_and(|found| found.miss.rms_mm < 0.05));
            }
        }
    }
    assert_eq!(off, 0, "round trips over 0.05 mm");
}

#[test]
#[ignore = "minutes: the fixed point, to compare"]
fn the_fixed_point_on_the_same_bodies() {
    let preset = std::env::var("PRESET").unwrap_or_else(|_| "tiny".into());
    let volunteer = volunteer(&preset);
    for kind in KINDS {
        for breast_kpa in [0.2, 0.3, 0.5] {
            let _ = unloaded(&volunteer, Tissues { breast_kpa, kind, ..SOFT }, Method::FixedPoint);
        }
    }
}

#[test]
fn a_supine_body_that_slides_against_friction_returns_to_its_shape() {
    let tissues =
        Tissues { breast_kpa: 0.3, kind: InterfaceKind::NoSeparation, friction: 0.1, ..SOFT };
    let found = unloaded(&volunteer("tiny"), tissues, Method::Inverse).unwrap();
    assert!(found.miss.rms_mm < 0.05, "{:?}", found.miss);
    assert!(found.loaded.checks.friction_lag <= 1e-4, "{:?}", found.loaded.checks);
}

#[test]
#[ignore = "minutes: friction on the chest wall"]
fn bodies_that_slide_against_friction() {
    let preset = std::env::var("PRESET").unwrap_or_else(|_| "tiny".into());
    let volunteer = volunteer(&preset);
    let mut off = 0;
    for breast_kpa in [0.2, 0.3, 0.5] {
        for friction in [0.0, 0.1, 0.3] {
            let kind = InterfaceKind::NoSeparation;
            let tissues = Tissues { breast_kpa, kind, friction, ..SOFT };
            let found = unloaded(&volunteer, tissues, Method::Inverse);
            off += usize::from(!found.is_ok_and(|found| found.miss.rms_mm < 0.05));
        }
    }
    assert_eq!(off, 0, "round trips over 0.05 mm");
}
