#![allow(clippy::unwrap_used)]
use mammotwin_data::{labels::Side, progress::Silent, study::*};
use mammotwin_stages::{compress::Compress, volunteer::{Preset, Torso, mechanics::TruthBody}};
use std::time::Instant;
#[test]
fn probe() {
    let torso = Torso::new(Preset::named("tiny").unwrap().person(7), 7);
    for size in [16.0, 13.0, 11.0, 9.0, 7.5] {
        let t = Instant::now();
        let body = TruthBody::new(&torso, MeshPlan { size_mm: size, elements: Elements::Linear }, &Silent).unwrap();
        println!("size {size}: nodes {} body {:.1}s", body.mesh.points.len(), t.elapsed().as_secs_f64());
        let plan = mammotwin_stages::volunteer::model_plan(&torso.person);
        let base = CompressPlan { side: Side::Right, view: View::Cc, view_angle_deg: None, receptor_lift_mm: 0.0, start_pose: None, paddle: PaddleName::Rigid, hinge: None, plate: None, curve: None, gimbal: None, outline: None, spot: None, biopsy: None, cushion: None, cad: None, chest_wall_distance_mm: 15.0, stop: StopPlan { thickness_mm: Some(40.0), ..StopPlan::default() }, law: CompressLaw { name: LawName::Gent, jm: Some(2.0), constants: LawConstants::default(), poisson: 0.499 }, friction: 0.0, gravity_share: 0.0, rate_stiffening: 0.0 };
        let ways: Vec<(&str, CompressPlan)> = vec![("base", base.clone()), ("off+5", CompressPlan { chest_wall_distance_mm: 20.0, ..base.clone() }), ("jm1", CompressPlan { law: CompressLaw { jm: Some(1.0), ..base.law.clone() }, ..base.clone() }), ("jm0.7", CompressPlan { law: CompressLaw { jm: Some(0.7), ..base.law.clone() }, ..base.clone() }), ("fric", CompressPlan { friction: 0.4, ..base.clone() }), ("flex", CompressPlan { paddle: PaddleName::Flex, ..base.clone() }), ("elastic", CompressPlan { paddle: PaddleName::Elastic, ..base.clone() }), ("grav", CompressPlan { gravity_share: 1.0, ..base.clone() }), ("rate", CompressPlan { rate_stiffening: 1.0, ..base.clone() })];
        for (name, plan_c) in if size > 11.5 { ways } else { ways[..2].to_vec() } {
            let t = Instant::now();
            let made = Compress { model: plan.clone(), plan: plan_c }.press(&body.body(&plan), &body.mesh.points, body.moduli(), None, &Silent);
            match made {
                Ok(c) => {
                    let ext: Vec<f64> = c.steps.iter().map(|s| s.points.iter().map(|p| p[1] as f64).fold(0.0, f64::max)).collect();
                    println!(" {name} {:.1}s nodes {} {:?}\n   h {:.1?}\n   F {:.3?}\n   R {:.3?}\n   A {:.0?}\n   E {:.1?}\n   T {:.2?}\n   D {:.2?}", t.elapsed().as_secs_f64(), c.mesh.points.len(), c.stopped_early, c.curve.thickness_mm, c.curve.force_n, c.curve.receptor_force_n, c.curve.contact_area_mm2, ext, c.curve.tilt_deg, c.curve.deflection_mm);
                }
                Err(e) => println!(" {name} {:.1}s {e}", t.elapsed().as_secs_f64()),
            }
        }
    }
}
