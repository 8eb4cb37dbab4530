//! What is measured of a breast against the digital volunteer, whose skin, nipple and gland are known:
//! stress-free, on voxels of 1 mm, from her true labels.

use crate::common::as_pir;

use mammotwin_data::{
    Vec3,
    io::nifti::{self, Version},
    labels::{LabelMap, Side, Tissue},
    progress::Silent,
    store::Stage,
    study::LabelName,
    volume::{Grid, Volume},
};
use mammotwin_imaging::mri::synthesize::{Coil, Sample, Scan, Substance, scan};
use mammotwin_stages::{
    measure::{Measure, NippleFrom, PoseMeasures},
    relabel::Relabel,
    segment::Segment,
    surface::Surface,
    volunteer::{
        Motion, PoseName, PosedBody, Preset, Settings, Torso, Truth, mechanics::TruthBody,
        synthesize, torso,
    },
};

/// What is at a place of the stress-free body; behind the chest wall there is muscle, then lung.
fn sample(torso: &Torso, p: &Vec3) -> Sample {
    let chest_wall = torso.chest_wall(p);
    let (substance, tissue) = match chest_wall {
        depth if depth > 0.0 => torso.soft(p, chest_wall),
        depth if depth > -8.0 => (Substance::Muscle, Tissue::PectoralMuscle),
        _ => (Substance::Lung, Tissue::Thorax),
    };
    Sample { substance, tissue, material: *p }
}

/// Both breasts of a person, with a coil in front of each and noise as her scans have it.
fn scanned(torso: &Torso, voxel_mm: f64) -> (Volume<f32>, LabelMap) {
    let low = Vec3::new(-140.0, 30.0, -85.0);
    let high = Vec3::new(140.0, 160.0, 85.0);
    let shape = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / voxel_mm) as usize);
    let grid = Grid::aligned(shape, [voxel_mm; 3], low);
    let centers = vec![Vec3::new(75.0, 150.0, 20.0), Vec3::new(-75.0, 150.0, -20.0)];
    let coil = Coil { centers, reach_mm: 75.0, floor: 0.1 };
    let protocol = Scan { coil, fat: 800.0, noise: 800.0 / 55.0, noise_seed: 3, texture_seed: 4 };
    let picture = scan(&grid, &protocol, &|p: &Vec3| sample(torso, p), &Silent);
    (picture.magnitude, picture.labels)
}

/// Thickness (mm) of the skin along a normal inwards, from just outside: 0 without any.
fn true_skin_mm(what: &impl Fn(&Vec3) -> Sample, p: &Vec3, inward: &Vec3) -> f64 {
    const STEP_MM: f64 = 0.05;
    let at = |n: i32| what(&(p + f64::from(n) * STEP_MM * inward)).substance;
    f64::from((-60..160).map(at).filter(|s| *s == Substance::Skin).count() as u32) * STEP_MM
}

fn measured(image: &Volume<f32>, labels: &LabelMap) -> PoseMeasures {
    let surfaces = Surface::default().run(labels, &Silent).unwrap();
    Measure.run(&(image.clone(), labels.clone(), surfaces, None, None), &Silent).unwrap()
}

#[test]
fn skin_nipple_and_volumes_come_near_those_of_the_volunteer() {
    let torso = Torso::new(Preset::named("small").unwrap().person(51), 51);
    let (image, mut labels) = scanned(&torso, 1.0);
    // A person who labels by hand may leave the areola to the skin: the shape has to tell.
    for tissue in labels.values.iter_mut().filter(|t| **t == Tissue::NippleAreola) {
        *tissue = Tissue::Skin;
    }
    let found = measured(&image, &labels);

    // Skin: its true thickness is seen along each normal.
    let normals = found.skin.vertex_normals();
    let what = |p: &Vec3| sample(&torso, p);
    let skin: Vec<(Vec3, f64, f64)> = (0..found.skin.points.len())
        .step_by(5)
        .map(|n| (found.skin.points[n], found.skin_mm[n], -normals[n]))
        .map(|(p, mm, inward)| (p, mm, true_skin_mm(&what, &p, &inward)))
        .filter(|(p, ..)| (p - torso.nearer(p).apex).norm() > 20.0)
        .collect();
    let errors: Vec<f64> = skin.iter().map(|(_, mm, exact)| mm - exact).collect();
    let count = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / count;
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
    println!("skin beside the areola: {count} places, mean error {mean:.3} mm, rms {rms:.3} mm");
    assert!(count > 2000.0, "{count} places");
    assert!(mean.abs() < 0.1 && rms < 0.2);

    for one in &found.sides {
        let side = one.side;
        let frame = &torso.breasts[usize::from(side == Side::Left)];
        let true_skin: Vec<f64> = {
            let own = skin.iter().filter(|(p, ..)| p.x * side.sign() > 0.0);
            let mut all: Vec<f64> = own.map(|(.., exact)| *exact).collect();
            all.sort_by(f64::total_cmp);
            [0.05, 0.5, 0.95].map(|share| all[(share * (all.len() - 1) as f64) as usize]).to_vec()
        };
        let skin = one.skin.unwrap();
        let tip = frame.apex + 6.0 * frame.outward;
        let off = (one.nipple_mm - tip).norm();
        let [_, _, out] = torso::local(frame, &one.nipple_mm);
        println!(
            "{}: skin {:.2} ({:.2} - {:.2}) mm, true {true_skin:.2?}, told on {:.0} %; nipple {:.1} mm \
             from its tip, by {}; protrusion {:.1} mm, nipple {out:.1} mm over the base; {:.0} cm3, gland \
             {:.3}",
            side.name(),
            skin.median_mm,
            skin.p05_mm,
            skin.p95_mm,
            100.0 * skin.seen,
            off,
            one.nipple_from.name(),
            one.protrusion_mm,
            one.volume_cm3,
            one.gland_share
        );
        assert!((skin.median_mm - true_skin[1]).abs() < 0.25);
        assert_eq!(one.nipple_from, NippleFrom::Bump);
        assert!(off < 4.0, "{off} mm");
        let exact = frame.apex + 6.0 * frame.outward;
        let height = torso.chest_wall(&exact);
        assert!((one.protrusion_mm - height).abs() < 2.5, "{} {height}", one.protrusion_mm);
        let count = |of: &dyn Fn(Tissue) -> bool| {
            let own = labels.values.iter().enumerate().filter(|(n, t)| {
                of(**t) && labels.grid.center(labels.grid.voxel(*n)).x * side.sign() > 0.0
            });
            own.count() as f64 * labels.grid.voxel_mm3() / 1000.0
        };
        assert!((one.volume_cm3 / count(&Tissue::is_breast) - 1.0).abs() < 0.01);
        assert!((one.gland_cm3 - count(&Tissue::is_gland)).abs() < 1e-6);
    }
}

#[test]
fn voxels_that_do_not_resolve_skin_give_no_thickness() {
    let torso = Torso::new(Preset::named("small").unwrap().person(52), 52);
    let (image, labels) = scanned(&torso, 2.5);
    let found = measured(&image, &labels);
    assert!(found.skin_mm.is_empty() && found.no_skin.contains("2.5 mm do not resolve"));
    assert!(found.sides.iter().all(|one| one.skin.is_none()));
    let metrics = found.metrics("supine");
    assert!(metrics.iter().all(|m| !m.name.contains("skin")) && metrics.len() == 14);
    assert!(found.sides.iter().all(|one| one.nipple_from == NippleFrom::Label));
}

/// The whole way from images of poses, segmented without help, to the measures.
#[test]
#[ignore = "minutes: a volunteer on voxels of 1 mm, segmented without help"]
fn skin_of_poses_comes_near_that_of_the_volunteer() {
    let folder = tempfile::tempdir().unwrap();
    let poses = [PoseName::Supine, PoseName::Prone];
    let (preset, seed) = ("small", 53);
    let settings =
        Settings { seed, poses: poses.to_vec(), ..Settings::demo(preset, folder.path()) };
    synthesize(&settings, &Silent).unwrap();
    let truth = Truth::load(&folder.path().join("truth/truth.json")).unwrap();
    let torso = Torso::new(Preset::named(preset).unwrap().person(seed), seed);
    let bodies = TruthBody::new(&torso, torso.person.truth_mesh, &Silent).unwrap();
    for pose in poses {
        let name = pose.name();
        let image = nifti::read(&folder.path().join(format!("{name}.nii.gz"))).unwrap();
        let labels = Segment.run(&(image.clone(), None, None), &Silent).unwrap();
        let surfaces = Surface::default().run(&labels, &Silent).unwrap();
        let input = (image.clone(), labels, surfaces, None, None);
        let found = Measure.run(&input, &Silent).unwrap();
        let deformed = bodies.deform(pose, &Silent).unwrap();
        let shapes = bodies.shapes(&deformed);
        let motion = Motion::drawn(&torso, pose, seed);
        let grid = &image.grid;
        let corners = [grid.center([0; 3]), grid.center(grid.shape.map(|n| n - 1))];
        let body = PosedBody::new(&torso, &motion, &shapes, corners, 2.5);
        let normals = found.skin.vertex_normals();
        let marks = &truth.poses[name].landmarks;
        let errors: Vec<f64> = (0..found.skin.points.len())
            .step_by(5)
            .map(|n| (found.skin.points[n], found.skin_mm[n], -normals[n]))
            .filter(|(p, ..)| {
                ["nipple_right", "nipple_left"].iter().all(|m| (p - marks.0[*m]).norm() > 20.0)
            })
            .map(|(p, mm, inward)| mm - true_skin_mm(&|p| body.sample(p), &p, &inward))
            .collect();
        let count = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
        println!("{name}: {count} places, skin mean error {mean:.3} mm, rms {rms:.3} mm");
        for one in &found.sides {
            let off = (one.nipple_mm - marks.0[&format!("nipple_{}", one.side.name())]).norm();
            println!("{name}: {one:.2?}; nipple {off:.1} mm from the marker under it");
        }
        assert!(count > 1000.0 && mean.abs() < 0.1 && rms < 0.25);
    }
}

/// Finished labels of another program: other numbers, sides not told, 16 bit, sagittal slices.
#[test]
fn labels_of_another_program_in_another_order_measure_the_same() {
    let torso = Torso::new(Preset::named("small").unwrap().person(54), 54);
    let (image, labels) = scanned(&torso, 2.5);
    let number = |tissue: Tissue| match tissue {
        Tissue::AdiposeRight | Tissue::AdiposeLeft => 300,
        Tissue::FibroglandularRight | Tissue::FibroglandularLeft => 20,
        other => 1000 * u16::from(other.label()),
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("labels.nii.gz");
    let turned = as_pir(&labels);
    nifti::write_raw_labels(&path, &turned.map(number), Version::One).unwrap();
    let summary = nifti::inspect(&path).unwrap();
    assert_eq!((summary.orientation.as_str(), summary.dtype.as_str()), ("PIR", "uint16"));
    let names = [
        ("300", LabelName::Adipose),
        ("20", LabelName::Fibroglandular),
        ("5000", LabelName::Skin),
        ("6000", LabelName::PectoralMuscle),
        ("7000", LabelName::Thorax),
        ("8000", LabelName::NippleAreola),
        ("9000", LabelName::Other),
    ];
    let map = names.map(|(number, name)| (number.to_owned(), name)).into();
    let raw = nifti::read_raw_labels(&path).unwrap();
    let read = Relabel { map }.run(&raw, &Silent).unwrap();
    assert_eq!(read.values, turned.values, "sides or tissues were exchanged");

    let (ras, pir) = (measured(&image, &labels), measured(&image, &read));
    for (a, b) in ras.sides.iter().zip(&pir.sides) {
        let moved = (a.nipple_mm - b.nipple_mm).norm();
        println!(
            "protrusion {:.4}, {:.4} mm; nipple {moved:.4} mm",
            a.protrusion_mm, b.protrusion_mm
        );
        assert_eq!((a.side, a.gland_cm3), (b.side, b.gland_cm3));
        assert!((a.volume_cm3 / b.volume_cm3 - 1.0).abs() < 1e-6);
        assert!((a.protrusion_mm - b.protrusion_mm).abs() < 0.02 && moved < 0.1);
    }
}
