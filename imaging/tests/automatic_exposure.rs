//! What automatic exposure holds constant, and how dose then rises with thickness.

use mammotwin_data::tables;
use mammotwin_imaging::xray::{
    attenuation::Material,
    dose::{DoseBeam, average_glandular_dose},
    geometry::Geometry,
    spectrum::Spectrum,
    transport::{
        bodies::HalfCylinder,
        exam::{MEDIA, Setup, examine},
        photon::Histories,
    },
};

/// CsI layer (mm) of mammography panels, as simulators take it.
const CSI_MM: f64 = 0.1;

/// Dose (mGy per unit of signal) of a half cylinder of 20 % gland when the detector must get one unit of what
/// `signal` makes of each line behind it.
fn dose(thickness: f64, beam: &Spectrum, signal: impl Fn(f64) -> f64, more: f64) -> f64 {
    let tissue = Material::breast(0.2).unwrap();
    let air = Material::named("air").unwrap();
    let behind = beam.behind(&tissue, thickness).unwrap();
    let per_photon: f64 = behind.lines.iter().map(|l| l.share * signal(l.energy_kev)).sum();
    let kerma = beam.kerma_mgy_mm2(&air, 0.0).unwrap() * Geometry::pristina(0.1).closer(thickness);
    let rhodium = DoseBeam::rhodium_silver_34_kvp();
    average_glandular_dose(kerma / (per_photon * more), thickness, 0.2, &rhodium).unwrap().agd_mgy
}

/// Scatter over primary without and behind a grid, and their relative errors.
fn scatter(thickness: f64, beam: &Spectrum, photons: u64) -> [[f64; 2]; 2] {
    let body = HalfCylinder {
        radius: 80.0,
        bottom: 0.0,
        top: thickness,
        slope: 0.0,
        skin: 1.45,
        media: MEDIA,
    };
    let setup = Setup { paddle_mm: 0.0, ..Setup::usual(0.2).unwrap() };
    let histories = Histories { photons, seed: 1 };
    let exam = examine(body, &setup, &Geometry::pristina(0.1), beam, histories).unwrap();
    let disc = |x: f64, y: f64| x.hypot(y - 40.0) < 25.0;
    let [bare, grid] = [exam.scatter_to_primary(disc), exam.behind_grid(disc)].map(Option::unwrap);
    [[bare.mean, bare.error], [grid.mean, grid.error]]
}

/// The printed table gives whole millimetres and hundredths of a mGy: what changes of dose, and of dose per mm,
/// it allows.
fn printed() -> Vec<[f64; 4]> {
    let rows: Vec<[f64; 2]> = tables::rows(tables::THESIS_5_10)
        .map(|row| [2, 3].map(|k| row[k].parse().unwrap()))
        .collect();
    let percent = |to: f64, from: f64| 100.0 * (to / from - 1.0);
    rows.chunks(2)
        .map(|pair| {
            let [[t1, a1], [t2, a2]] = [pair[0], pair[1]];
            let [low, high] = [percent(a2 - 0.005, a1 + 0.005), percent(a2 + 0.005, a1 - 0.005)];
            let step = t1 - t2;
            [low, high, -high / (step + 1.0), -low / (step - 1.0)]
        })
        .collect()
}

/// Eight things that automatic exposure might hold constant. Nothing is fitted: the numbers stand in `docs/xray.md`.
#[test]
fn what_is_held_constant_sets_how_dose_rises() {
    let mono = Spectrum::mono(24.0);
    let [air, pmma, csi] = ["air", "pmma", "csi"].map(|name| Material::named(name).unwrap());
    let tube = Spectrum::of_tube("Rh/Ag", 34).unwrap();
    let tube = tube.behind(&air, 560.0).unwrap().behind(&pmma, 2.5).unwrap().of_all();
    let photons = |_: f64| 1.0;
    let energy = |kev: f64| kev * (1.0 - (-CSI_MM * csi.attenuation_per_mm(kev).unwrap()).exp());
    let thickness = [44.0, 46.0, 48.0];
    // On a line between thicknesses far apart: chance moves the slope little.
    let far = [36.0, 56.0];
    let scattered = |beam: &Spectrum| {
        let [thin, thick] = far.map(|t| scatter(t, beam, 4_000_000));
        println!("scatter over primary ± error, bare and behind a grid: {thin:.4?}, {thick:.4?}");
        thickness.map(|t| {
            let part = (t - far[0]) / (far[1] - far[0]);
            [0, 1].map(|k| (1.0 - part) * thin[k][0] + part * thick[k][0])
        })
    };
    let [of_mono, of_tube] = [scattered(&mono), scattered(&tube)];
    let change = |doses: [f64; 3]| {
        [[0, 1], [1, 2]].map(|[thin, thick]: [usize; 2]| 100.0 * (doses[thin] / doses[thick] - 1.0))
    };
    let one = |beam: &Spectrum, signal: &dyn Fn(f64) -> f64, more: &dyn Fn(usize) -> f64| {
        change([0, 1, 2].map(|n| dose(thickness[n], beam, signal, more(n))))
    };
    let alone = |_: usize| 1.0;
    let with_grid = |s: [[f64; 2]; 3]| move |n: usize| 1.0 + s[n][1];
    let without = |s: [[f64; 2]; 3]| move |n: usize| 1.0 + s[n][0];
    let contrast = |s: [[f64; 2]; 3]| move |n: usize| 1.0 / (1.0 + s[n][1]);
    let all = [
        ("24 keV, primary", one(&mono, &photons, &alone)),
        ("24 keV, primary and scatter behind a grid", one(&mono, &photons, &with_grid(of_mono))),
        ("24 keV, primary and scatter without a grid", one(&mono, &photons, &without(of_mono))),
        ("34 kV Rh/Ag, primary photons", one(&tube, &photons, &alone)),
        ("34 kV Rh/Ag, energy in CsI, primary", one(&tube, &energy, &alone)),
        (
            "34 kV Rh/Ag, energy in CsI, primary and scatter behind a grid",
            one(&tube, &energy, &with_grid(of_tube)),
        ),
        (
            "34 kV Rh/Ag, energy in CsI, primary and scatter without a grid",
            one(&tube, &energy, &without(of_tube)),
        ),
        (
            "34 kV Rh/Ag, squared contrast over noise behind a grid",
            one(&tube, &energy, &contrast(of_tube)),
        ),
    ];
    for (what, [thin, thick]) in &all {
        println!("{what}: 46 to 44 mm {thin:.2} %, 48 to 46 mm {thick:.2} %");
    }
    let printed = printed();
    println!("printed (least, most, per mm least, most): {printed:.2?}");
    // Each of them is a slope that the printed figures allow, since 2 mm may be 1 to 3 mm.
    for (what, changes) in &all {
        for (change, [_, _, least, most]) in changes.iter().zip(&printed) {
            let per_mm = -0.5 * change;
            assert!((*least..*most).contains(&per_mm), "{what}: {per_mm} of {least} to {most}");
        }
    }
    // Scatter that counts as signal saves dose, more without a grid; a softer beam costs more of it.
    let of = |n: usize| all[n].1[0];
    assert!(of(2) > of(1) && of(1) > of(0) && of(0) > of(3), "{all:?}");
    assert!(of(6) > of(5) && of(5) > of(4) && of(4) > of(7), "{all:?}");
}
