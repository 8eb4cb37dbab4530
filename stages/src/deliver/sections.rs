//! The sections of the report, each from the results of one or two stages.

use super::{html::Images, measured};
use crate::{
    calibrate::{Calibration, Parameter, Trial},
    compress::Compression,
    mammogram::Mammograms,
    mesh::BreastMesh,
    phantom::CompressedPhantom,
    pose::PoseFit,
    register::Registered,
    report::{
        CompressionReport, Fact, FitReport, MammogramReport, MeshReport, PoseReport,
        RegistrationReport, SurfaceMap,
        chart::{Axis, Chart, Histogram, Line, Mark},
        mammogram::{Region, Tone, detail, whole},
        palette::Palette,
        surface::Camera,
    },
    segment::{REAR_SEEN, Segmented, WALL_SEEN},
    validate::Validation,
    wall_distance,
};
use mammotwin_data::{
    labels::Side, mesh::Patch, metric::Metric, rigid::RigidTransform, surface::TriMesh,
    units::DEGREE,
};

/// Ends of the colour scale of all distance maps (mm): one scale, so that maps compare.
const DISTANCE_RANGE_MM: [f64; 2] = [-5.0, 5.0];

/// Images and what became of them.
pub fn poses(names: &[String], images: &Images, segmented: &Segmented) -> Vec<PoseReport> {
    let (pictures, surfaces, measures, registered) = images;
    let mut reports = Vec::new();
    for (n, (name, picture)) in names.iter().zip(pictures).enumerate() {
        let mut report = PoseReport {
            name: name.clone(),
            outlines: picture.outlines.clone(),
            ..PoseReport::default()
        };
        if let Some(found) = measures.get(n) {
            (report.facts, report.skin) = measured::section(found);
        }
        let seen = segmented.get(name).map(|notes| &notes.values);
        for (note, words) in [
            (WALL_SEEN, "Chest wall seen behind the breasts"),
            (REAR_SEEN, "Rear of the muscle seen"),
        ] {
            let share = seen.and_then(|values| values.get(note));
            report
                .facts
                .extend(share.map(|share| Fact::new(words, format!("{:.0} %", 100.0 * share))));
        }
        let moving = n.checked_sub(1).and_then(|m| registered.get(m));
        if let (Some(moving), Some(own), Some(fixed)) = (moving, surfaces.get(n), surfaces.first())
        {
            let t: &RigidTransform = &moving.transform;
            let g = moving.gravity;
            let mut facts = vec![
                Fact::new("Rotation", format!("{:.1}°", t.angle() / DEGREE)),
                Fact::new(
                    "Gravity, RAS",
                    format!("({:.3}, {:.3}, {:.3})", g.x, g.y, g.z).replace('-', "−"),
                ),
            ];
            if let Some(rms) = moving.start.landmark_rms_mm {
                facts.push(Fact::new("Landmarks, rms", format!("{rms:.2} mm")));
            }
            if let Some(image) = &moving.image {
                let (before, after) = (image.similarity_before, image.similarity_after);
                facts.push(Fact::new("Correlation", format!("{before:.3} → {after:.3}")));
                if let Some(rms) = image.change_rms_mm {
                    facts.push(Fact::new("Change of the chest wall, rms", format!("{rms:.1} mm")));
                }
            }
            if let Some(wall) = &moving.wall {
                let text =
                    format!("95 % within {:.1} mm, all within {:.1} mm", wall.p95_mm, wall.max_mm);
                facts.push(Fact::new("Front of the muscle from the reference's", text));
            }
            report.registration = Some(RegistrationReport {
                facts,
                overlays: picture.overlays.clone(),
                chest_wall: wall_map(&own.chest_wall, &fixed.chest_wall, t),
            });
        }
        reports.push(report);
    }
    reports
}

/// Distance of the chest wall of a pose to that of the reference pose.
fn wall_map(moving: &TriMesh, fixed: &TriMesh, transform: &RigidTransform) -> Option<SurfaceMap> {
    let (surface, values) = wall_distance::moved(moving, fixed, transform).ok()?;
    Some(SurfaceMap {
        title: "Chest wall after registration".into(),
        caption: "Signed distance to the chest wall of the reference pose: what the rigid motion \
                  leaves (Mîra 2018, fig. 3.4). Grey: where one of the images ends."
            .into(),
        surface,
        values,
        label: "distance (mm)".into(),
        palette: Palette::Diverging,
        range: Some(DISTANCE_RANGE_MM),
        cameras: vec![Camera::Front],
    })
}

/// How far the fronts of the muscles of registered poses are from the reference's.
pub fn walls(names: &[String], registered: &[Registered]) -> Vec<Metric> {
    let both = names.iter().zip(registered);
    both.filter_map(|(name, found)| found.wall.map(|wall| wall.metrics(name))).flatten().collect()
}

/// The mesh.
pub fn mesh(mesh: &BreastMesh) -> MeshReport {
    let summary = &mesh.quality.summary;
    let shapes = &mesh.quality.shapes;
    let histogram = |title: &str, x: &str, values: Vec<f64>, range, limit| Histogram {
        title: title.into(),
        caption: String::new(),
        x_label: x.into(),
        values,
        range,
        limit: Some(limit),
    };
    MeshReport {
        facts: vec![
            Fact::new("Tetrahedra", summary.tets.to_string()),
            Fact::new("Nodes", mesh.mesh.points.len().to_string()),
            Fact::new("Volume", format!("{:.0} ml", mesh.mesh.volume_mm3() / 1000.0)),
            Fact::new("Skewness over 0.75", summary.over_075.to_string()),
            Fact::new("Largest skewness", format!("{:.2}", summary.max_skewness)),
            Fact::new("Largest aspect ratio", format!("{:.1}", summary.max_aspect_ratio)),
            Fact::new("Largest angle", format!("{:.0}°", summary.max_angle_deg)),
        ],
        histograms: vec![
            histogram(
                "Skewness",
                "skewness",
                shapes.iter().map(|s| s.skewness).collect(),
                Some([0.0, 1.0]),
                0.75,
            ),
            histogram(
                "Aspect ratio",
                "aspect ratio",
                shapes.iter().map(|s| s.aspect_ratio).collect(),
                None,
                20.0,
            ),
            histogram(
                "Largest corner angle",
                "angle (°)",
                shapes.iter().map(|s| s.max_angle_deg).collect(),
                Some([60.0, 180.0]),
                165.0,
            ),
        ],
    }
}

fn distance_fact(name: &str, before: &PoseFit, after: &PoseFit) -> Fact {
    let (before, after) = (before.distances.modified_hausdorff, after.distances.modified_hausdorff);
    Fact::new(name, format!("{before:.2} → {after:.2} mm"))
}

/// Signed distance on the simulated skin.
fn distance_map(mesh: &BreastMesh, fit: &PoseFit, title: String) -> SurfaceMap {
    let mut values = vec![f64::NAN; fit.solution.points.len()];
    for (&n, &signed) in fit.active.iter().zip(&fit.signed_mm) {
        values[n as usize] = signed;
    }
    let triangles = mesh.mesh.patch(Patch::Skin).to_vec();
    let d = &fit.distances;
    SurfaceMap {
        title,
        caption: format!(
            "Mean {:.2}, 95 % {:.2}, largest {:.2} mm; grey skin is not compared.",
            d.mean, d.p95, d.max
        ),
        surface: TriMesh { points: fit.solution.points.clone(), triangles },
        values,
        label: "simulated - measured (mm)".into(),
        palette: Palette::Diverging,
        range: Some(DISTANCE_RANGE_MM),
        cameras: vec![Camera::Front, Camera::Right, Camera::Left],
    }
}

/// Stress-free shape and moduli.
pub fn calibration(mesh: &BreastMesh, calibration: &Calibration) -> FitReport {
    let Calibration { before, after, trials, precision, .. } = calibration;
    let fitted = trials.len() > 1;
    let moduli = |side: Side| {
        let [then, now] = [before, after].map(|fit| fit.moduli.of_side(side));
        match precision.of_side(side) {
            Some(sd) => format!("{then:.3} → {now:.3} kPa{}", interval(now, sd)),
            None if fitted => format!("{then:.3} → {now:.3} kPa"),
            None => format!("{now:.3} kPa"),
        }
    };
    let mut facts = vec![
        Fact::new("Right breast", moduli(Side::Right)),
        Fact::new("Left breast", moduli(Side::Left)),
    ];
    for parameter in Parameter::shared() {
        let Some(now) = parameter.given(&after.moduli) else { continue };
        let known = precision.of(parameter).map(|sd| interval(now, sd)).unwrap_or_default();
        facts.push(Fact::new(&parameter.title(), parameter.written(now) + &known));
    }
    facts.push(Fact::new("Evaluations", trials.len().to_string()));
    let mut maps = Vec::new();
    for (then, now) in before.poses.iter().zip(&after.poses) {
        facts.push(distance_fact(&format!("Skin distance, {}", now.pose), then, now));
        if fitted && now.pose != after.poses[0].pose {
            maps.push(distance_map(mesh, then, format!("{} before the fit", now.pose)));
        }
        maps.push(distance_map(mesh, now, format!("{} after the fit", now.pose)));
    }
    let charts = if fitted { vec![search_chart(trials)] } else { Vec::new() };
    FitReport { facts, charts, maps, ..FitReport::default() }
}

/// Standard deviations on either side that hold 90 % of a normal distribution.
const NINETY: f64 = 1.645;

/// Where 90 % lie of a number whose logarithm has this standard deviation.
fn interval(value: f64, sd: f64) -> String {
    let [low, high] = [-NINETY, NINETY].map(|part| value * (part * sd).exp());
    format!(" (90 %: {low:.3} – {high:.3})")
}

/// How well the stress-free shape, loaded again, takes the reference pose.
pub fn round_trip(calibration: &Calibration) -> Vec<Metric> {
    let trip = &calibration.after.round_trip;
    let source = "stress-free shape, loaded again";
    let long = |what: &str| format!("Reference pose from the stress-free shape: {what}");
    vec![
        Metric::new("round_trip_rms_mm", &long("rms of the nodes"), "mm", trip.rms_mm, source),
        Metric::new("round_trip_max_mm", &long("farthest node"), "mm", trip.max_mm, source),
        Metric::new(
            "off_wall_max_mm",
            "Way of sliding nodes onto the chest wall before unloading",
            "mm",
            trip.off_wall_mm,
            source,
        ),
    ]
}

fn search_chart(trials: &[Trial]) -> Chart {
    let line = |name: &str, of: &dyn Fn(&Trial) -> (f64, f64)| {
        let mut points: Vec<(f64, f64)> = trials.iter().map(of).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Line { name: name.into(), points }
    };
    let marks = trials.last().map_or(Vec::new(), |t| {
        vec![
            Mark { name: "right, last".into(), point: (t.moduli.right_kpa, t.residual_right_mm) },
            Mark { name: "left, last".into(), point: (t.moduli.left_kpa, t.residual_left_mm) },
        ]
    });
    Chart {
        title: "Search for the moduli".into(),
        caption: "Mean signed distance of the skin that faces along gravity; positive: the \
                  simulated breast sags too far."
            .into(),
        x_label: "Young's modulus (kPa)".into(),
        y_label: "residual (mm)".into(),
        lines: vec![
            line("right", &|t| (t.moduli.right_kpa, t.residual_right_mm)),
            line("left", &|t| (t.moduli.left_kpa, t.residual_left_mm)),
        ],
        marks,
        x_axis: Axis::Rising,
    }
}

/// The held-out pose.
pub fn validation(mesh: &BreastMesh, validation: &Validation) -> (String, FitReport) {
    let Validation { before, after } = validation;
    let d = &after.distances;
    let report = FitReport {
        facts: vec![
            distance_fact("Modified Hausdorff", before, after),
            Fact::new("Mean", format!("{:.2} mm", d.mean)),
            Fact::new("Largest", format!("{:.2} mm", d.max)),
            Fact::new("Hausdorff", format!("{:.2} mm", d.hausdorff)),
            Fact::new("Thesis, modified Hausdorff of its tilted pose", "6.14 mm"),
        ],
        maps: vec![
            distance_map(mesh, before, format!("{} before the fit", before.pose)),
            distance_map(mesh, after, format!("{} after the fit", after.pose)),
        ],
        ..FitReport::default()
    };
    (after.pose.clone(), report)
}

/// The compression.
pub fn compression(compression: &Compression) -> CompressionReport {
    let curve = &compression.curve;
    let points = |values: &[f64]| {
        curve.thickness_mm.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>()
    };
    let chart = |title: &str, y: &str, lines: Vec<Line>| Chart {
        title: title.into(),
        caption: String::new(),
        x_label: "thickness (mm)".into(),
        y_label: y.into(),
        lines,
        marks: Vec::new(),
        x_axis: Axis::Falling,
    };
    let line = |name: &str, values: &[f64]| Line { name: name.into(), points: points(values) };
    let checks = &compression.solution.checks;
    let triangles = compression.mesh.patch(Patch::Skin).to_vec();
    CompressionReport {
        facts: vec![
            Fact::new("Breast", compression.side.name()),
            Fact::new("Thickness", format!("{:.1} mm", compression.thickness_mm)),
            Fact::new("Force", format!("{:.1} N", curve.force_n.last().copied().unwrap_or(0.0))),
            Fact::new("Load steps", curve.thickness_mm.len().to_string()),
            Fact::new("Smallest det F", format!("{:.2}", checks.min_det_f)),
            Fact::new("Deepest penetration", format!("{:.3} mm", checks.max_penetration_mm)),
        ],
        curves: vec![
            chart(
                "Force against thickness",
                "force (N)",
                vec![line("paddle", &curve.force_n), line("receptor", &curve.receptor_force_n)],
            ),
            chart(
                "Pressure of the plates",
                "pressure (kPa)",
                vec![
                    line("mean", &curve.mean_pressure_kpa),
                    line("largest, its face", &curve.paddle_peak_pressure_kpa),
                    line("largest, both plates with fronts", &curve.peak_pressure_kpa),
                ],
            ),
        ],
        maps: vec![SurfaceMap {
            title: "Contact pressure".into(),
            caption: "On the skin between paddle and receptor.".into(),
            surface: TriMesh { points: compression.solution.points.clone(), triangles },
            values: compression.contact_pressure_kpa.clone(),
            label: "pressure (kPa)".into(),
            palette: Palette::Sequential,
            range: None,
            cameras: vec![Camera::Above, Camera::Front, Camera::Right],
        }],
    }
}

/// Pixels of the longest side of a whole mammogram in the report.
const WHOLE_PIXELS: usize = 900;
/// Size (pixels) of the part that is shown at full size.
const DETAIL_PIXELS: usize = 400;

/// Pictures of the compressed breast.
pub fn mammograms(
    compression: &Compression,
    phantom: &CompressedPhantom,
    made: &Mammograms,
) -> Vec<MammogramReport> {
    let side = compression.side;
    let letter = if side == Side::Right { "R" } else { "L" };
    let mut reports = Vec::new();
    for (technique, picture) in made.techniques.iter().zip(&made.pictures) {
        let depth = phantom.surface.points.iter().map(|p| p.y).fold(0.0, f64::max);
        let row = (0.5 * depth / picture.pitch_mm) as usize;
        let region = Region {
            row: row.saturating_sub(DETAIL_PIXELS / 2),
            column: picture.columns.saturating_sub(DETAIL_PIXELS) / 2,
            size: DETAIL_PIXELS,
        };
        reports.push(MammogramReport {
            title: format!("{letter} CC, {} mm microcalcifications", technique.diameter_mm),
            caption: format!(
                "Incident air kerma {:.2} mGy; primary photons and quantum noise only.",
                technique.kerma_mgy
            ),
            mark: format!("{letter} CC"),
            picture: whole(picture, Tone::Signal, side, WHOLE_PIXELS),
            detail: Some(detail(picture, Tone::Signal, side, region)),
        });
    }
    reports
}

/// The numbers at the top.
pub fn headlines(
    calibration: &Calibration,
    validations: &[Validation],
    compression: Option<&Compression>,
    metrics: &[Metric],
) -> Vec<Fact> {
    let mut facts = Vec::new();
    for fit in calibration.after.poses.iter().skip(1) {
        let name = format!("Skin distance, {}", fit.pose);
        facts.push(Fact::new(&name, format!("{:.2} mm", fit.distances.modified_hausdorff)));
    }
    for v in validations {
        let name = format!("Held out, {}", v.after.pose);
        facts.push(Fact::new(&name, format!("{:.2} mm", v.after.distances.modified_hausdorff)));
    }
    if let Some(c) = compression {
        facts.push(Fact::new("Thickness", format!("{:.1} mm", c.thickness_mm)));
    }
    let wanted = [
        ("force_n", "Compression force"),
        ("peak_pressure_kpa", "Largest pressure, fronts too"),
        ("agd_mgy", "Average glandular dose"),
    ];
    for (name, words) in wanted {
        if let Some(m) = metrics.iter().find(|m| m.name == name) {
            facts.push(Fact::new(words, format!("{:.2} {}", m.value, m.unit)));
        }
    }
    facts
}

/// What was done, in a few sentences.
pub fn summary(
    poses: &[String],
    calibration: &Calibration,
    validations: &[Validation],
    compression: Option<&Compression>,
) -> String {
    let mut text = format!("Images: {}. ", poses.join(", "));
    let moduli = calibration.after.moduli;
    let (right, left) = (moduli.right_kpa, moduli.left_kpa);
    text += &if calibration.trials.len() > 1 {
        format!("Fitted Young's moduli: {right:.2} kPa right, {left:.2} kPa left. ")
    } else {
        format!("Given Young's moduli: {right:.2} kPa right, {left:.2} kPa left; nothing fitted. ")
    };
    for v in validations {
        let (then, now) =
            (v.before.distances.modified_hausdorff, v.after.distances.modified_hausdorff);
        text +=
            &format!("Held-out pose {}: {then:.2} mm before, {now:.2} mm after. ", v.after.pose);
    }
    if let Some(c) = compression {
        let force = c.curve.force_n.last().copied().unwrap_or(0.0);
        let thickness = c.thickness_mm;
        text += &format!(
            "The {} breast is compressed to {thickness:.1} mm with {force:.1} N.",
            c.side.name()
        );
    }
    text
}
