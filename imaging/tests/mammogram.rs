//! A mammogram of a known shape: from surface to quality and dose.

use mammotwin_data::{
    Vec3,
    study::{CalcificationPlan, Exposure, MammogramPlan},
    surface::TriMesh,
};
use mammotwin_imaging::xray::{
    calibration::{Anchor, Unit, calibrate},
    dose::average_glandular_dose,
    exposure::expose,
    phantom::Phantom,
    project::project,
    quality::{quality, summary},
};

/// Half of a breast between plates, cut at y = -20: an ellipse of 75 x 85 mm with a round rim.
fn compressed(thickness: f64) -> TriMesh {
    let (around, up) = (240u32, 60u32);
    let mut points = vec![];
    let half = 0.5 * thickness;
    for k in 0..=up {
        // From the lower plate over the rim to the upper plate.
        let (z, out) = {
            let t = f64::from(k) / f64::from(up);
            let angle = std::f64::consts::PI * (t - 0.5);
            (half + half * angle.sin(), half * angle.cos() - half)
        };
        for n in 0..=around {
            let angle = std::f64::consts::PI * f64::from(n) / f64::from(around);
            let (x, y) = ((75.0 + out) * angle.cos(), (85.0 + out) * angle.sin());
            points.push(Vec3::new(x, y - 20.0, z));
        }
    }
    let at = |k: u32, n: u32| k * (around + 1) + n;
    let mut triangles = vec![];
    for k in 0..up {
        for n in 0..around {
            triangles.push([at(k, n), at(k, n + 1), at(k + 1, n + 1)]);
            triangles.push([at(k, n), at(k + 1, n + 1), at(k + 1, n)]);
        }
        // The rear wall.
        triangles.push([at(k, around), at(k, 0), at(k + 1, 0)]);
        triangles.push([at(k, around), at(k + 1, 0), at(k + 1, around)]);
    }
    for n in 1..around {
        triangles.push([at(0, 0), at(0, n + 1), at(0, n)]);
        triangles.push([at(up, 0), at(up, n), at(up, n + 1)]);
    }
    TriMesh { points, triangles }
}

#[test]
fn thicker_breasts_cost_more_dose_at_the_same_signal() {
    let plan = MammogramPlan {
        pixel_mm: 0.2,
        calcifications: CalcificationPlan { rows: 3, columns: 3, ..Default::default() },
        ..Default::default()
    };
    let unit = Unit::pristina(plan.pixel_mm, plan.energy_kev);
    let calibration = calibrate(&Anchor::default(), &unit).unwrap();
    let agd = [44.0, 46.0].map(|thickness| {
        let phantom = Phantom::new(compressed(thickness), thickness, &plan, 0.3, 1).unwrap();
        assert_eq!(phantom.calcifications.len(), 9);
        let projection = project(&phantom, &unit.geometry).unwrap();
        let picture =
            expose(&phantom, &projection, &unit, &calibration, Exposure::Automatic, 1).unwrap();
        let regions = quality(&picture.noisy, &phantom, &unit.geometry).unwrap();
        // Pixels of four times the area hold four times the quanta of the anchor.
        let snr = summary(&regions, |r| r.detrended.snr).unwrap().mean;
        assert!((snr / (2.0 * 132.0) - 1.0).abs() < 0.05, "{snr}");
        average_glandular_dose(picture.kerma_mgy, thickness, plan.glandularity, &unit.dose_beam)
            .unwrap()
            .agd_mgy
    });
    assert!((agd[1] / 1.15 - 1.0).abs() < 0.05, "{agd:?}");
    assert!((0.94..0.97).contains(&(agd[0] / agd[1])), "{agd:?}");
}
