//! Refuses paddles that cannot be meant.

use super::validate::{Checked, refuse, within};
use super::{CompressPlan, HingePlan, OutlinePlan, PaddleName, SpotName};

/// The paddle of a compression and its tables.
pub(super) fn paddle(plan: &CompressPlan) -> Checked {
    for (key, given, paddle) in [
        ("hinge", plan.hinge.is_some(), PaddleName::Flex),
        ("plate", plan.plate.is_some(), PaddleName::Elastic),
        ("curve", plan.curve.is_some(), PaddleName::Curved),
        ("gimbal", plan.gimbal.is_some(), PaddleName::Tilting),
        ("spot", plan.spot.is_some(), PaddleName::Spot),
        ("biopsy", plan.biopsy.is_some(), PaddleName::Biopsy),
        ("cushion", plan.cushion.is_some(), PaddleName::Cushion),
        ("cad", plan.cad.is_some(), PaddleName::Cad),
    ] {
        if given && plan.paddle != paddle {
            let name = paddle.name();
            let why =
                format!("only a {name} paddle has one; remove it, or write paddle = {name:?}");
            return refuse(format!("compress.{key}"), why);
        }
    }
    // Plates are at least 30 mm wide: their round corners are no sharper than the edges.
    let radius = plan.edge_radius_mm;
    let mut numbers = vec![("edge_radius_mm", radius, 1.0, 15.0)];
    if let Some(hinge) = &plan.hinge {
        numbers.push(("hinge.axis_mm", hinge.axis_mm, -100.0, 300.0));
        numbers.push(("hinge.linear_n_mm_per_rad", hinge.linear_n_mm_per_rad, 1.0, 1e9));
        let quadratic = hinge.quadratic_n_mm_per_rad2;
        numbers.push(("hinge.quadratic_n_mm_per_rad2", quadratic, 0.0, 1e10));
        let assumed = HingePlan { file: None, axis_mm: hinge.axis_mm, ..HingePlan::default() };
        if hinge.file.is_some() && (HingePlan { file: None, ..hinge.clone() }) != assumed {
            let why = "has the torques; remove linear_n_mm_per_rad and quadratic_n_mm_per_rad2";
            return refuse("compress.hinge.file", why);
        }
    }
    if let Some(plate) = plan.plate {
        numbers.push(("plate.width_mm", plate.width_mm, 20.0, 500.0));
        numbers.push(("plate.depth_mm", plate.depth_mm, 20.0, 500.0));
        numbers.push(("plate.thickness_mm", plate.thickness_mm, 0.1, 50.0));
        numbers.push(("plate.young_mpa", plate.young_mpa, 1.0, 1e6));
        numbers.push(("plate.poisson", plate.poisson, 0.0, 0.49));
        numbers.push(("plate.lip_mm", plate.lip_mm, 0.0, 100.0));
    }
    if let Some(curve) = plan.curve {
        numbers.push(("curve.rise_mm", curve.rise_mm, 0.0, 100.0));
        numbers.push(("curve.reach_mm", curve.reach_mm, 5.0, 300.0));
        numbers.push(("curve.arch_radius_mm", curve.arch_radius_mm.unwrap_or(1e3), 100.0, 1e5));
    }
    if let Some(gimbal) = plan.gimbal {
        numbers.push(("gimbal.axis_mm", gimbal.axis_mm, -100.0, 300.0));
        numbers.push(("gimbal.tilt_n_mm_per_rad", gimbal.tilt_n_mm_per_rad, 1.0, 1e9));
        numbers.push(("gimbal.roll_n_mm_per_rad", gimbal.roll_n_mm_per_rad, 1.0, 1e9));
    }
    if let Some(outline) = plan.outline {
        numbers.push(("outline.width_mm", outline.width_mm, 30.0, 500.0));
        numbers.push(("outline.depth_mm", outline.depth_mm, 30.0, 500.0));
        let most = 0.5 * outline.width_mm.min(outline.depth_mm);
        numbers.push(("outline.corner_mm", outline.corner_mm, radius, most));
    }
    if let Some(spot) = plan.spot {
        numbers.push(("spot.size_mm", spot.size_mm, 30.0, 200.0));
        if spot.shape == SpotName::Square {
            let most = 0.5 * spot.size_mm;
            numbers.push(("spot.corner_mm", spot.corner_mm, radius, most));
        }
        numbers.push(("spot.along_mm", spot.along_mm, -200.0, 200.0));
        numbers.push(("spot.away_mm", spot.away_mm, 0.0, 200.0));
    }
    if let Some(biopsy) = plan.biopsy {
        numbers.push(("biopsy.window_width_mm", biopsy.window_width_mm, 10.0, 200.0));
        numbers.push(("biopsy.window_depth_mm", biopsy.window_depth_mm, 10.0, 200.0));
        let most = 0.5 * biopsy.window_width_mm.min(biopsy.window_depth_mm);
        numbers.push(("biopsy.corner_mm", biopsy.corner_mm, 1.0, most));
        numbers.push(("biopsy.along_mm", biopsy.along_mm, -200.0, 200.0));
        numbers.push(("biopsy.away_mm", biopsy.away_mm, 0.0, 200.0));
    }
    if let Some(cushion) = plan.cushion {
        numbers.push(("cushion.thickness_mm", cushion.thickness_mm, 0.5, 50.0));
        numbers.push(("cushion.young_kpa", cushion.young_kpa, 0.1, 10_000.0));
    }
    for (key, value, low, high) in numbers {
        within(&format!("compress.{key}"), value, low, high)?;
    }
    outline(plan)
}

/// What ends a paddle, and what is left around its window.
fn outline(plan: &CompressPlan) -> Checked {
    match plan.paddle {
        PaddleName::Spot | PaddleName::Cad if plan.outline.is_some() => {
            let name = plan.paddle.name();
            let why = format!("a {name} paddle has one of its own; remove it");
            refuse("compress.outline", why)
        }
        PaddleName::Biopsy => window(plan),
        PaddleName::Cad => match &plan.cad {
            None => {
                let why = "needs a file; add cad = { file = \"paddle.stl\" }";
                refuse("compress.paddle", why)
            }
            Some(cad) => {
                let name = cad.file.as_os_str().as_encoded_bytes();
                if name.is_empty() || name.contains(&0) {
                    return refuse("compress.cad.file", "not the name of a file");
                }
                Ok(())
            }
        },
        _ => Ok(()),
    }
}

fn window(plan: &CompressPlan) -> Checked {
    let plate = plan.outline.unwrap_or(OutlinePlan::SMALL);
    let window = plan.biopsy.unwrap_or_default();
    // The rounded edges of window and plate must not meet.
    let bar = 2.0 * plan.edge_radius_mm;
    let sides = 0.5 * (plate.width_mm - window.window_width_mm) - window.along_mm.abs();
    let rear = plate.depth_mm - window.away_mm - window.window_depth_mm;
    for (key, left) in
        [("away_mm", window.away_mm), ("window_width_mm", sides), ("window_depth_mm", rear)]
    {
        if left < bar {
            let why = format!(
                "leaves {left} mm of the plate between the window and its border; leave {bar} mm or more"
            );
            return refuse(format!("compress.biopsy.{key}"), why);
        }
    }
    Ok(())
}
