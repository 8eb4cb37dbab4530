//! What a fit says beside its distances: markers on the breasts, what the data cannot tell, how much is left.

use crate::{
    calibrate::{Calibration, Parameter},
    fiducials::{Fiducials, Summary},
    model::skin_through_skin,
    report::Fact,
};
use mammotwin_data::{
    Vec3,
    labels::Side,
    mesh::TetMesh,
    metric::Metric,
    study::{InterfaceKind, LayerPlan, ModelPlan},
};
use mammotwin_solver::mesh::quality::quality;

/// Said where no marker tests the fit.
pub const NO_FIDUCIAL: &str = "No marker on the breasts (breast_..., nipple_...) is in the reference pose and in another one: \
    skins are compared by their distance alone, and nothing shows how far tissue slid along them.";

/// Markers of a pose, before and after the fit.
pub fn markers(found: &Fiducials) -> Vec<Fact> {
    let (Some(before), Some(after), Some(moved)) =
        (found.before(), found.after(), found.moved_mm())
    else {
        return Vec::new();
    };
    let pose = &found.pose;
    let way = |of: fn(&Summary) -> f64| format!("{:.1} → {:.1}", of(&before), of(&after));
    let mut facts = vec![
        Fact::new(
            &format!("Markers, {pose}"),
            format!(
                "{} mm off in the mean, {} mm at most; they moved by {moved:.1} mm",
                way(|s| s.mean_mm),
                way(|s| s.max_mm)
            ),
        ),
        Fact::new(
            &format!("Markers along the skin, {pose}"),
            format!(
                "{} mm in the mean, {} mm at most",
                way(|s| s.tangential_mean_mm),
                way(|s| s.tangential_max_mm)
            ),
        ),
    ];
    for marker in &found.markers {
        let (then, now) = (marker.before, marker.after);
        let text = format!(
            "{:.1} → {:.1} mm along the skin, {:.1} → {:.1} mm along the normal",
            then.tangential_mm, now.tangential_mm, then.normal_mm, now.normal_mm
        );
        facts.push(Fact::new(&format!("{}, {pose}", marker.name), text.replace('-', "−")));
    }
    facts
}

/// Warnings about markers: none at all, and those that are not on the model's skin.
pub fn marker_warnings(all: &[Fiducials], moved: bool) -> Vec<String> {
    let mut warnings = Vec::new();
    if moved && all.iter().all(|pose| pose.markers.is_empty()) {
        warnings.push(NO_FIDUCIAL.into());
    }
    for pose in all.iter().filter(|pose| !pose.off_skin.is_empty()) {
        let names = pose.off_skin.join(", ");
        let text = format!(
            "{}: not compared, since farther than 10 mm from the model's skin in the reference pose: {names}",
            pose.pose
        );
        warnings.push(text);
    }
    warnings
}

/// A warning of a state whose tetrahedra `tets` are stretched, with the nodes at `points` (mm), beyond what the mesh itself may
/// have (skewness 0.95); none where none is.
pub fn stretched(state: &str, points: &[Vec3], tets: &[[u32; 4]]) -> Option<String> {
    let summary = quality(points, tets).summary;
    let (over, worst) = (summary.over_095, summary.max_skewness);
    (over > 0).then(|| {
        format!(
            "{state}: {over} of {} deformed elements are beyond skewness 0.95 (at most {worst:.3}): stress there is of the mesh, \
             not of the tissue",
            tets.len()
        )
    })
}

/// A warning of a state in which skin passes through skin, with the nodes of `mesh` at `points` (mm).
pub fn passes_through_itself(state: &str, mesh: &TetMesh, points: &[Vec3]) -> Option<String> {
    let (node, deep_mm) = skin_through_skin(mesh, points)?;
    let place = points[node as usize];
    Some(format!(
        "{state}: skin passes {deep_mm:.1} mm deep through skin at ({:.0}, {:.0}, {:.0}) mm: set model.skin_contact to true",
        place.x, place.y, place.z
    ))
}

/// Standard deviation of a logarithm from which poses hardly tell a number: a factor of 1.6.
const UNTOLD: f64 = 0.5;
/// Correlation from which two numbers are told together only.
const TOGETHER: f64 = 0.8;

/// What the poses cannot tell, in plain words.
pub fn untold(model: &ModelPlan, parameters: &[String], calibration: &Calibration) -> Vec<String> {
    let mut text = Vec::new();
    let density = model.density_g_per_cm3;
    text.push(format!(
        "Under gravity only the ratio of density to stiffness acts: with the density ({density} g/cm³) and all moduli (breast, \
         skin, fascia, ligaments) multiplied by one number no pose changes. The moduli are those of this density."
    ));
    let is_fitted = |parameter: Parameter| parameters.iter().any(|key| key == parameter.key());
    let layer = |plan: &LayerPlan| {
        format!("{} kPa, {} mm ({})", plan.young_kpa, plan.thickness_mm, plan.law.name())
    };
    let breast = &model.breast;
    let mut held = vec![format!(
        "law ({}) and Poisson's ratio ({}) of the breast",
        breast.law.name(),
        breast.poisson
    )];
    for (parameter, given) in [
        (Parameter::Skin, format!("skin: {}", layer(&model.skin))),
        (Parameter::Fascia, format!("fascia: {}", layer(&model.fascia))),
        (Parameter::Ligaments, format!("ligaments: {} kPa", model.ligaments.young_kpa)),
    ] {
        if !is_fitted(parameter) {
            held.push(given);
        }
    }
    held.push(format!("chest wall: {}", model.interface.kind.name()));
    for side in [Side::Right, Side::Left] {
        if !is_fitted(Parameter::of_side(side)) {
            let kpa = calibration.after.moduli.of_side(side);
            held.insert(0, format!("modulus of the {} breast ({kpa:.3} kPa)", side.name()));
        }
    }
    text.push(format!("Held at what the study gives: {}.", held.join("; ")));
    text.extend(shared_told(calibration));
    if calibration.fitted() && !is_fitted(Parameter::Skin) {
        text.push(
            "Skin and fascia were not fitted: they carry a part of the weight, and where they are stiffer than the study has \
             them, the breast comes out too stiff, else too soft. The stated intervals know nothing of it."
                .into(),
        );
        if model.interface.kind == InterfaceKind::Bonded && model.muscle.rigid {
            text.push(
                "The breast is bonded to a rigid chest wall: the fascia lies on it, carries nothing, and no pose tells of it."
                    .into(),
            );
        }
    }
    if let Some(correlation) = calibration.precision.correlation(Parameter::Right, Parameter::Left)
    {
        text.push(
            format!(
                "Errors of the right and the left modulus have a correlation of {correlation:.2}: what is not known of one {} the other.",
                if correlation.abs() < 0.3 { "says little about" } else { "goes with that of" }
            )
            .replace('-', "−"),
        );
    }
    if let Some(second) = &calibration.second {
        let from = [second.from.right_kpa, second.from.left_kpa]
            .map(|kpa| format!("{kpa:.2}"))
            .join(" and ");
        text.push(match &second.end {
            Some(end) => format!(
                "A second search from {from} kPa (right, left) ended at {:.3} and {:.3} kPa after {} evaluations: {}.",
                end.right_kpa,
                end.left_kpa,
                second.evaluations,
                if second.agrees(&calibration.after.moduli) { "as the first one" } else { "elsewhere than the first one" }
            ),
            None => format!("A second search from {from} kPa (right, left) found no equilibrium."),
        });
    }
    text
}

/// How well the poses tell what both breasts share, and what they tell of it and the breasts together only.
fn shared_told(calibration: &Calibration) -> Vec<String> {
    let precision = &calibration.precision;
    let told = |parameter: Parameter| {
        let value = parameter.given(&calibration.after.moduli)?;
        let Some(sd) = precision.of(parameter) else {
            let words = parameter.words();
            return Some(format!("The poses tell nothing of {words}, which was to be fitted."));
        };
        let mut text = format!(
            "{}: {} within a factor of {:.2}",
            parameter.title(),
            parameter.written(value),
            sd.exp()
        );
        if parameter.is_bound(value) {
            text += ", the end of what is searched";
        }
        if sd > UNTOLD {
            text += ", so the poses hardly tell it";
        }
        let with = |side: &Side| precision.correlation(parameter, Parameter::of_side(*side));
        let with: Vec<f64> = [Side::Right, Side::Left].iter().filter_map(with).collect();
        if let Some(most) = with.into_iter().max_by(|a, b| a.abs().total_cmp(&b.abs())) {
            text += &format!("; correlation with the modulus of a breast {most:.2}");
            if most.abs() > TOGETHER {
                text += ": the poses tell both together only";
            }
        }
        Some(format!("{text}.").replace("breast -", "breast −"))
    };
    Parameter::shared().filter_map(told).collect()
}

/// What a second search says against the first one.
pub fn second_start_warning(calibration: &Calibration) -> Option<String> {
    let second = calibration.second.as_ref()?;
    (!second.agrees(&calibration.after.moduli)).then(|| {
        "A second search from other moduli did not end where the first one did: the moduli depend on where the search begins".into()
    })
}

/// Numbers of the fit and of the markers, for the tables of results.
pub fn metrics(calibration: &Calibration, fiducials: &[Fiducials]) -> Vec<Metric> {
    let mut metrics = Vec::new();
    if let (Some(misfit_mm), Some(lack)) = (calibration.misfit_mm(), calibration.lack_of_fit()) {
        let source = "fitted poses, after their best rigid motions";
        let long = "Root mean square distance that the fit leaves";
        metrics.push(Metric::new("misfit_rms_mm", long, "mm", misfit_mm, source));
        let long = "Lack of fit: that over the 1.2 mm that chest wall and labels explain";
        metrics.push(Metric::new("lack_of_fit", long, "", lack, source));
    }
    for pose in fiducials {
        let Some(after) = pose.after() else { continue };
        let source = "markers on the breasts, carried by the simulated skin";
        for (name, words, value) in [
            ("mean", "mean distance", after.mean_mm),
            ("max", "largest distance", after.max_mm),
            ("tangential_mean", "mean distance along the skin", after.tangential_mean_mm),
            ("tangential_max", "largest distance along the skin", after.tangential_max_mm),
        ] {
            let long = format!("Markers, {}: {words}", pose.pose);
            metrics.push(Metric::new(
                &format!("{}_fiducials_{name}_mm", pose.pose),
                &long,
                "mm",
                value,
                source,
            ));
        }
    }
    metrics
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::put_calibration;
    use crate::{
        calibrate::{Fit, Precision, RoundTrip, SecondStart, Trial},
        fiducials::{Fiducial, Miss},
        model::Moduli,
        pose::PoseFit,
    };
    use mammotwin_data::{Vec3, io::hdf5, mesh::TetMesh, solution::Solution};
    use mammotwin_solver::distance::Distances;

    /// A fit of prone to supine that leaves `misfit_mm`.
    fn calibration(misfit_mm: f64) -> Calibration {
        let moduli = Moduli::new(0.31, 0.22);
        let pose = |pose: &str| PoseFit {
            pose: pose.into(),
            gravity: Vec3::y(),
            solution: Solution::default(),
            active: Vec::new(),
            signed_mm: Vec::new(),
            distances: Distances {
                min: 0.0,
                max: 1.0,
                mean: 0.5,
                p95: 0.9,
                hausdorff: 1.0,
                modified_hausdorff: 0.5,
            },
        };
        let round_trip = RoundTrip { rms_mm: 0.0, max_mm: 0.0, off_wall_mm: 0.0 };
        let fit = Fit {
            moduli,
            round_trip,
            rest: Vec::new(),
            poses: vec![pose("supine"), pose("prone")],
        };
        let trial = |misfit_mm| Trial {
            moduli,
            residual_right_mm: 0.0,
            residual_left_mm: 0.0,
            misfit_mm,
            modified_hausdorff_mm: 1.0,
        };
        Calibration {
            before: fit.clone(),
            after: fit,
            trials: vec![trial(8.0), trial(misfit_mm)],
            converged: true,
            precision: Precision {
                keys: Parameter::ALL[..3].iter().map(|known| known.key().into()).collect(),
                covariance: vec![0.01, -0.0012, -0.027, -0.0012, 0.01, 0.0, -0.027, 0.0, 0.09],
                independent: 40.0,
            },
            second: None,
        }
    }

    #[test]
    fn poses_that_contradict_each_other_are_told_and_good_ones_are_not() {
        assert_eq!(calibration(1.2).contradiction(), None, "as much as chest walls explain");
        assert_eq!(calibration(1.2).lack_of_fit(), Some(1.0));
        let told = calibration(6.0).contradiction().unwrap();
        assert!(told.contains("6.0 mm (rms) are left, 5.0 times"), "{told}");
        let mut given = calibration(6.0);
        given.trials.truncate(1);
        assert_eq!(given.contradiction(), None, "nothing was fitted: the moduli may be wrong");
        let numbers = metrics(&calibration(6.0), &[]);
        assert_eq!((numbers[1].name.as_str(), numbers[1].value), ("lack_of_fit", 5.0));
        given.after.poses.truncate(1);
        assert!(metrics(&given, &[]).is_empty(), "one pose leaves nothing to compare");
    }

    #[test]
    fn what_the_poses_cannot_tell_names_what_was_held() {
        let model = ModelPlan::default();
        let breasts: Vec<String> = Parameter::ALL[..2].iter().map(|p| p.key().into()).collect();
        let all = untold(&model, &breasts, &calibration(1.0)).join(" ");
        for part in [
            "0.981 g/cm³",
            "skin: 10 kPa, 2 mm",
            "fascia: 160 kPa",
            "Skin and fascia were not fitted",
            "−0.12",
        ] {
            assert!(all.contains(part), "{part}: {all}");
        }
        assert!(!all.contains("modulus of the"), "{all}");
        let one = untold(&model, &breasts[..1], &calibration(1.0)).join(" ");
        assert!(
            one.contains("modulus of the left breast (0.220 kPa)")
                && !one.contains("right breast ("),
            "{one}"
        );
    }

    #[test]
    fn a_skin_that_was_fitted_is_told_with_what_it_cannot_be_told_from() {
        let mut found = calibration(1.0);
        found.after.moduli.shared.skin_kpa = Some(4.2);
        let keys: Vec<String> = Parameter::ALL[..3].iter().map(|p| p.key().into()).collect();
        let all = untold(&ModelPlan::default(), &keys, &found).join(" ");
        assert!(all.contains("Skin: 4.200 kPa within a factor of 1.35"), "{all}");
        assert!(all.contains("breast −0.90: the poses tell both together only"), "{all}");
        assert!(!all.contains("Skin and fascia were not fitted") && !all.contains("skin: 10 kPa"));
        let mut ended = found.clone();
        ended.after.moduli.shared.skin_kpa = Some(200.0);
        let all = untold(&ModelPlan::default(), &keys, &ended).join(" ");
        assert!(all.contains("1.35, the end of what is searched"), "{all}");
        let mut unknown = found.clone();
        unknown.precision = Precision::default();
        let all = untold(&ModelPlan::default(), &keys, &unknown).join(" ");
        assert!(all.contains("The poses tell nothing of skin"), "{all}");

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.h5");
        for (found, known) in [(&found, true), (&unknown, false)] {
            let mut file = hdf5::Writer::create(&path).unwrap();
            put_calibration(&mut file, found, &keys, &TetMesh::default()).unwrap();
            file.finish().unwrap();
            let file = hdf5::Reader::open(&path).unwrap();
            let of = |name: &str| format!("calibration/shared/skin_young_kpa/{name}");
            assert_eq!(file.scalar::<f64>(&of("value")).unwrap(), 4.2);
            assert_eq!(file.has(&of("draws")), known);
            if known {
                assert!((file.scalar::<f64>(&of("sd_ln")).unwrap() - 0.3).abs() < 1e-12);
                assert_eq!(file.get::<f64>(&of("draws")).unwrap().len(), 1000);
                let with = file.scalar::<f64>(&of("correlation_right")).unwrap();
                assert!((with + 0.9).abs() < 1e-12, "{with}");
            }
        }
    }

    #[test]
    fn a_state_with_stretched_elements_is_a_warning() {
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let mut points =
            vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(1.0, 1.0, 1.0)];
        assert_eq!(stretched("supine", &points, &tets), None);
        points[0] = Vec3::new(0.33, 0.33, 0.33);
        let told = stretched("supine", &points, &tets).unwrap();
        assert!(told.contains("supine: 1 of 2 deformed elements"), "{told}");
    }

    #[test]
    fn a_second_search_that_ends_elsewhere_is_a_warning() {
        let mut found = calibration(1.0);
        assert_eq!(second_start_warning(&found), None);
        let from = Moduli::new(1.5, 1.5);
        let second = |left_kpa: f64| SecondStart {
            from,
            end: Some(Moduli::new(0.31, left_kpa)),
            evaluations: 7,
        };
        found.second = Some(second(0.221));
        assert_eq!(second_start_warning(&found), None);
        assert!(
            untold(&ModelPlan::default(), &[], &found)
                .join(" ")
                .contains("7 evaluations: as the first one")
        );
        found.second = Some(second(0.4));
        assert!(second_start_warning(&found).is_some());
    }

    #[test]
    fn markers_are_told_one_by_one_and_none_is_pretended() {
        let miss = |normal_mm: f64, tangential_mm: f64| Miss {
            carried: Vec3::zeros(),
            normal_mm,
            tangential_mm,
        };
        let marker = Fiducial {
            name: "nipple_left".into(),
            reference: Vec3::zeros(),
            measured: 20.0 * Vec3::x(),
            before: miss(-3.0, 4.0),
            after: miss(0.6, 0.8),
        };
        let found = Fiducials {
            pose: "prone".into(),
            markers: vec![marker],
            off_skin: vec!["breast_left_outer".into()],
        };
        let facts = markers(&found);
        assert_eq!(
            facts[0].value,
            "5.0 → 1.0 mm off in the mean, 5.0 → 1.0 mm at most; they moved by 20.0 mm"
        );
        assert_eq!(facts[2].name, "nipple_left, prone");
        assert_eq!(facts[2].value, "4.0 → 0.8 mm along the skin, −3.0 → 0.6 mm along the normal");
        let told = marker_warnings(&[found], true);
        assert!(told.len() == 1 && told[0].contains("breast_left_outer"), "{told:?}");
        let none = Fiducials { pose: "prone".into(), ..Fiducials::default() };
        assert!(
            markers(&none).is_empty()
                && metrics(&calibration(1.0), std::slice::from_ref(&none)).len() == 2
        );
        assert_eq!(marker_warnings(&[none], true), [NO_FIDUCIAL]);
        assert_eq!(marker_warnings(&[], true), [NO_FIDUCIAL]);
        assert!(marker_warnings(&[], false).is_empty(), "one pose alone needs none");
    }
}
