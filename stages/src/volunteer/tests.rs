//! The shape, what people add, and the picture, against what they promise.

use super::{motion::*, *};
use mammotwin_data::labels::Tissue;
use mammotwin_solver::mesh::{domain::Domain, tetrahedralize as solver_mesh};

fn torso(preset: &str, seed: u64) -> Torso {
    Torso::new(Preset::named(preset).unwrap().person(seed), seed)
}

/// A torso whose numbers are the preset's own.
fn nominal(preset: &str) -> Torso {
    Torso::new(Preset::named(preset).unwrap(), 1)
}

/// Volume (ml) of the right breast on its base, and the part of it that is gland.
fn breast(torso: &Torso) -> (f64, f64) {
    let (step, breast) = (2.0, &torso.person.breast);
    let frame = &torso.breasts[0];
    let [mut all, mut gland] = [0.0; 2];
    let reach = |length: f64| (length / step) as i32 + 1;
    for i in -reach(breast.base_x_mm)..=reach(breast.base_x_mm) {
        for k in -reach(breast.base_z_mm)..=reach(breast.base_z_mm) {
            let [u, w] = [f64::from(i) * step, f64::from(k) * step];
            if (u / breast.base_x_mm).hypot(w / breast.base_z_mm) > 1.0 {
                continue;
            }
            for j in -reach(30.0)..=reach(breast.projection_mm + 10.0) {
                let out = f64::from(j) * step;
                let p = frame.base + u * frame.lateral + w * Vec3::z() + out * frame.outward;
                let wall = torso.chest_wall(&p);
                if wall > 0.0 {
                    let (_, tissue) = torso.soft(&p, wall);
                    all += f64::from(u8::from(tissue.is_breast()));
                    gland += f64::from(u8::from(tissue == Tissue::FibroglandularRight));
                }
            }
        }
    }
    (all * step.powi(3) / 1000.0, gland / all)
}

#[test]
fn breasts_have_the_size_and_gland_of_their_preset() {
    let (small, gland) = breast(&nominal("small"));
    assert!((190.0..270.0).contains(&small), "small {small} ml");
    assert!((0.15..0.25).contains(&gland), "gland {gland}");
    let (large, gland) = breast(&nominal("large"));
    assert!((950.0..1250.0).contains(&large), "large {large} ml");
    assert!((0.15..0.25).contains(&gland), "gland {gland}");
}

/// A breast that hangs out of the preset's field of view widens it on that side alone.
#[test]
fn an_image_holds_all_of_the_breasts() {
    let person = Preset::named("large").unwrap();
    let [low, high] = [person.image.low_mm, person.image.high_mm];
    let inside = [Vec3::new(low[0] + 20.0, 0.0, 0.0), Vec3::new(high[0] - 20.0, 50.0, 0.0)];
    let usual = field_of_view(&person, Some([1.0; 3]), &inside);
    assert_eq!(usual.center([0; 3]).x, low[0]);
    let hangs = Vec3::new(low[0] - 10.0, 20.0, 0.0);
    let wide = field_of_view(&person, Some([1.0; 3]), &[&inside[..], &[hangs]].concat());
    assert_eq!(wide.center([0; 3]).x, hangs.x - SIDE_MM);
    assert_eq!(wide.shape[1..], usual.shape[1..]);
    let right = |grid: &Grid| grid.center([grid.shape[0] - 1, 0, 0]).x;
    assert!((right(&wide) - right(&usual)).abs() < 1.0);
}

#[test]
fn skin_is_as_thick_as_measured() {
    let torso = nominal("small");
    let marks = landmarks::stress_free(&torso);
    let thickness = |name: &str| torso.skin_mm(&marks.0[name]);
    assert!((4.0..5.0).contains(&thickness("nipple_right")));
    for name in ["breast_right_upper", "breast_right_outer", "breast_right_lower"] {
        assert!((0.83..2.35).contains(&thickness(name)), "{name}: {}", thickness(name));
    }
    assert!(thickness("breast_right_outer") < thickness("breast_right_lower"));
}

#[test]
fn the_chest_changes_by_one_to_three_mm_and_not_rigidly() {
    for seed in 0..4 {
        let torso = torso("small", seed);
        let places = chest_wall_places(&torso);
        let center = places.iter().sum::<Vec3>() / places.len() as f64;
        for pose in [PoseName::Prone, PoseName::Tilted, PoseName::Upright] {
            let motion = Motion::drawn(&torso, pose, seed);
            let moved: Vec<Vec3> = places.iter().map(|p| motion.chest.at(p)).collect();
            let square: f64 = moved.iter().map(|d| d.norm_squared()).sum();
            let rms = (square / moved.len() as f64).sqrt();
            assert!((1.0..3.0).contains(&rms), "{rms} mm");
            assert!((rms - motion.chest.rms_mm).abs() < 1e-9);
            let (shift, turn) = rigid_part(&places, &moved, &center);
            assert!(shift.norm() < 1e-9 && turn.norm() < 1e-11, "{shift} {turn}");
        }
        let supine = Motion::drawn(&torso, PoseName::Supine, seed);
        assert_eq!(supine.chest.at(&places[0]), Vec3::zeros());
    }
}

#[test]
fn a_table_moves_people_by_some_mm_and_gravity_follows() {
    let torso = torso("small", 3);
    for pose in PoseName::ALL {
        let motion = Motion::drawn(&torso, pose, 3).to_common;
        if let Some(down) = pose.gravity_of_posture() {
            assert!((motion.direction(&down) - pose.gravity()).norm() < 1e-12, "{pose:?}");
        }
        let degrees = motion.angle().to_degrees();
        let limit = if pose == PoseName::Prone { 11.0 } else { 5.0 };
        assert!(degrees < limit, "{pose:?}: {degrees} deg");
        if pose != PoseName::Supine {
            let center = Vec3::new(0.0, 40.0, 0.0);
            assert!((5.0..15.0).contains(&(motion.point(&center) - center).norm()));
        }
    }
}

#[test]
fn the_truth_mesh_is_not_the_model_mesh() {
    let torso = torso("small", 7);
    let size_mm = torso.person.truth_mesh.size_mm;
    let truth = mechanics::stress_free_mesh(&torso, size_mm).unwrap();
    let model = solver_mesh::tetrahedralize(
        &torso,
        &solver_mesh::Meshing::of_size(torso.person.study_mesh.size_mm),
        |_| Tissue::AdiposeRight,
    )
    .unwrap();
    // Eight linear tetrahedra have the nodes of a quadratic one.
    assert!(8 * truth.tets.len() > model.tets.len() && truth.tets.len() <= 25_000);
    let common = |p: &&Vec3| truth.points.iter().any(|q| (*p - q).norm() < 1e-3);
    let common: Vec<&Vec3> = model.points.iter().filter(common).collect();
    // Three patches meet at the eight corners of the tissue: any mesh has a node there.
    let corner = |p: &&Vec3| {
        let distances = torso.distances(p);
        distances.patches().filter(|&patch| distances.of(patch).abs() < 0.1).count() >= 3
    };
    assert!(common.len() <= 8 && common.iter().all(corner), "nodes in common: {common:?}");
    let volume = (truth.volume_mm3() / model.volume_mm3() - 1.0).abs();
    assert!(volume < 0.01, "volumes differ by {volume}");
}
