//! What the compression does to the breast: pressure, stress and strain.

mod compare;
mod mat;

pub use compare::{Comparison, compare};
pub use mat::PressureMat;

use crate::{compress::Compression, quality::Metrics, results::principal_stretches};
use mammotwin_data::{
    Failure, Vec3,
    metric::Metric,
    progress::Progress,
    solution::{principal_stresses_kpa, von_mises_kpa},
    store::Stage,
    study::ComfortPlan,
    units::NEWTON,
};
use mammotwin_solver::compress::Pressing;
use serde::Serialize;

/// Measures comfort at the end of the compression.
#[derive(Debug, Clone, Serialize)]
pub struct Comfort {
    /// Region near the chest wall, and pressure mat.
    pub plan: ComfortPlan,
}

/// A value with its share of area or volume.
pub type Weighted = (f64, f64);

/// The value that the given share of all weight does not exceed.
pub fn percentile(mut values: Vec<Weighted>, share: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = values.iter().map(|v| v.1).sum();
    let mut sum = 0.0;
    for (value, weight) in &values {
        sum += weight;
        if sum >= share * total {
            return *value;
        }
    }
    values.last().map_or(0.0, |v| v.0)
}

/// A part of the compressed breast, away from the chest wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region {
    /// Behind the plates' edges.
    Behind,
    /// The third of the part between the plates that is nearest to the chest wall.
    Rear,
    /// The middle third.
    Middle,
    /// The third with the nipple.
    Front,
}

impl Region {
    /// All of them, from the chest wall on.
    pub const ALL: [Self; 4] = [Self::Behind, Self::Rear, Self::Middle, Self::Front];

    /// As written in names of metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Behind => "behind",
            Self::Rear => "rear",
            Self::Middle => "middle",
            Self::Front => "front",
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Behind => "behind the plates",
            Self::Rear => "rear third between the plates",
            Self::Middle => "middle third",
            Self::Front => "front third",
        }
    }
}

/// What every tetrahedron bears.
#[derive(Debug, Clone)]
pub struct Burden {
    /// Von Mises stress (kPa).
    pub von_mises_kpa: Vec<f64>,
    /// Largest principal stress (kPa), positive in tension.
    pub largest_stress_kpa: Vec<f64>,
    /// Smallest principal stress (kPa), negative in compression.
    pub smallest_stress_kpa: Vec<f64>,
    /// Largest principal stretch.
    pub stretch: Vec<f64>,
    /// Smallest principal stretch, below one where tissue is shortened.
    pub smallest_stretch: Vec<f64>,
    /// Volume (mm³).
    pub volume_mm3: Vec<f64>,
    /// Where it is.
    pub region: Vec<Region>,
}

impl Burden {
    /// Of a compression.
    pub fn of(compression: &Compression) -> Self {
        let solution = &compression.solution;
        let points = &solution.points;
        let depth = points.iter().map(|p| p.y).fold(f64::MIN_POSITIVE, f64::max);
        let region = |tet: &[u32; 4]| {
            let y = tet.iter().map(|n| points[*n as usize].y).sum::<f64>() / 4.0;
            match 3.0 * y / depth {
                part if part < 0.0 => Region::Behind,
                part if part < 1.0 => Region::Rear,
                part if part < 2.0 => Region::Middle,
                _ => Region::Front,
            }
        };
        let stretches = solution.deformation_gradient.iter().map(principal_stretches);
        let (stretch, smallest_stretch) = stretches.map(|sorted| (sorted[0], sorted[2])).unzip();
        let principal = solution.cauchy_kpa.iter().map(principal_stresses_kpa);
        let (largest_stress_kpa, smallest_stress_kpa) =
            principal.map(|[most, least]| (most, least)).unzip();
        Self {
            largest_stress_kpa,
            smallest_stress_kpa,
            von_mises_kpa: solution.cauchy_kpa.iter().map(von_mises_kpa).collect(),
            stretch,
            smallest_stretch,
            volume_mm3: compression.volumes_mm3(),
            region: compression.mesh.tets.iter().map(region).collect(),
        }
    }

    /// Values with the volumes of their tetrahedra, in one region or everywhere.
    pub fn by_volume(&self, values: &[f64], region: Option<Region>) -> Vec<Weighted> {
        let here = |n: &usize| region.is_none_or(|region| self.region[*n] == region);
        let all = (0..values.len()).filter(here);
        all.map(|n| (values[n], self.volume_mm3[n])).collect()
    }
}

/// Place (mm, frame of the detector) of the node with the largest contact pressure; `None` where nothing presses.
pub fn peak(compression: &Compression) -> Option<Vec3> {
    let pressures = compression.contact_pressure_kpa.iter().enumerate();
    let (node, largest) = pressures.max_by(|a, b| a.1.total_cmp(b.1))?;
    (*largest > 0.0).then(|| compression.solution.points[node])
}

/// Contact pressure (kPa) of both plates node by node, with the area of their faces (mm²): an upright
/// front has next to none.
pub fn face_pressures(compression: &Compression) -> Vec<Weighted> {
    let areas = compression.face_areas_mm2();
    let both = compression.contact_pressure_kpa.iter().copied().zip(areas);
    both.filter(|&(pressure, area)| pressure > 0.0 && area > 0.0).collect()
}

impl Stage for Comfort {
    const NAME: &'static str = "comfort";
    const VERSION: u32 = 7;
    const METHODS: &'static str = "Comfort is described by the contact pressure by area of the plates' faces, their upright \
         fronts and other edges apart, by the place of the largest one, by the share of the force near the chest wall, by what a \
         virtual pressure mat shows, and by von Mises and principal stresses, largest stretch, largest and smallest logarithmic \
         strain by volume and region (after Mîra 2018, § 5.3.1); percentiles are given since maxima depend on the mesh.";
    type Input = Compression;
    type Output = Metrics;

    fn run(&self, compression: &Compression, _: &dyn Progress) -> Result<Metrics, Failure> {
        let mut metrics = Vec::new();
        let mut add = |name: &str, long: &str, unit: &str, value: f64, thesis: Option<f64>| {
            let metric = Metric::new(name, long, unit, value, "Mîra 2018, § 5.3.1, § 5.4.1");
            metrics.push(Metric { thesis, ..metric });
        };
        let curve = &compression.curve;
        let last = |values: &[f64]| values.last().copied().unwrap_or(0.0);
        let force_n = last(&curve.force_n);
        let thickness = compression.thickness_mm;
        add("thickness_mm", "compressed breast thickness", "mm", thickness, None);
        let long = "mean of smallest and largest distance of the plates";
        add("nominal_thickness_mm", long, "mm", compression.nominal_thickness_mm, None);
        let long = "how far the paddle gives way where it is touched";
        add("deflection_mm", long, "mm", last(&curve.deflection_mm), None);
        let long = "how far skin stands out above the paddle, beside it or in its window";
        add("bulge_mm", long, "mm", last(&curve.bulge_mm), None);
        add("force_n", "compression force", "N", force_n, None);
        let area_mm2 = last(&curve.contact_area_mm2);
        let long = "contact area of the paddle's face";
        add("contact_area_cm2", long, "cm2", area_mm2 / 100.0, None);
        let mean_kpa = if area_mm2 > 0.0 { force_n * NEWTON / area_mm2 } else { 0.0 };
        let long = "mean contact pressure under the paddle's face";
        add("mean_pressure_kpa", long, "kPa", mean_kpa, None);

        let (axis, away) = (Vec3::z(), Vec3::y());
        let on_paddle: Vec<Pressing> = compression.plates[1].touched().collect();
        let fronts = || on_paddle.iter().filter(|one| one.is_front(&axis, &away));
        let front_cm2 = fronts().map(|one| one.upright_area(&axis)).fold(0.0, |a, b| a + b) / 100.0;
        let long = "contact area of the paddle's upright front";
        add("front_area_cm2", long, "cm2", front_cm2, None);
        let front_n = fronts().map(|one| -one.force_mn.y).fold(0.0, |a, b| a + b) / NEWTON;
        let long = "force of the paddle's upright front towards the chest wall";
        add("front_force_n", long, "N", front_n, None);
        let long = "contact area of the paddle's other upright edges: sides, rear, window";
        let edge_cm2 = last(&curve.edge_area_mm2) / 100.0;
        add("edge_area_cm2", long, "cm2", edge_cm2, None);
        let down = |one: &Pressing| -one.force_mn.z;
        let all: f64 = on_paddle.iter().map(down).sum();
        let near = |one: &&Pressing| {
            compression.solution.points[one.node as usize].y < self.plan.juxtathoracic_mm
        };
        let near: f64 = on_paddle.iter().filter(near).map(down).sum();
        let within = self.plan.juxtathoracic_mm;
        let long = format!("share of the paddle's force within {within} mm of its chest-wall edge");
        let share = if all > 0.0 { near / all } else { 0.0 };
        add("juxtathoracic_share", &long, "", share, None);

        let most = compression.contact_pressure_kpa.iter().copied().fold(0.0, f64::max);
        add("peak_pressure_kpa", "largest contact pressure", "kPa", most, Some(77.7));
        if let Some(place) = peak(compression) {
            let of = "of the largest contact pressure, frame of the detector";
            let sides = [
                ("x", "along the chest-wall edge"),
                ("y", "away from the chest-wall edge of the plates"),
                ("z", "above the receptor"),
            ];
            for ((axis, words), mm) in sides.into_iter().zip(place.iter()) {
                add(
                    &format!("peak_pressure_{axis}_mm"),
                    &format!("place {of}: {words}"),
                    "mm",
                    *mm,
                    None,
                );
            }
            let near = f64::from(u8::from(place.y < self.plan.juxtathoracic_mm));
            let long = format!(
                "1 where the largest contact pressure lies within {within} mm of that edge, else 0"
            );
            add("peak_pressure_juxtathoracic", &long, "", near, None);
        }
        let pressures = face_pressures(compression);
        let touched = || compression.plates.iter().flat_map(|plate| plate.touched());
        let largest = |belongs: &dyn Fn(&Pressing) -> bool| {
            let here = touched().filter(|one| belongs(one));
            here.map(|one| one.pressure_kpa()).fold(0.0, f64::max)
        };
        let is_front = |one: &Pressing| one.is_front(&axis, &away);
        let is_edge = |one: &Pressing| one.is_upright(&axis) && !is_front(one);
        let long = "largest contact pressure on the plates' faces";
        add("face_peak_pressure_kpa", long, "kPa", largest(&|one| !one.is_upright(&axis)), None);
        let long = "largest contact pressure on the plates' fronts";
        add("front_peak_pressure_kpa", long, "kPa", largest(&is_front), None);
        let long = "largest contact pressure on the paddle's other upright edges";
        add("edge_peak_pressure_kpa", long, "kPa", largest(&is_edge), None);
        for (share, word) in [(0.95, "p95"), (0.99, "p99")] {
            let value = percentile(pressures.clone(), share);
            let long = format!("contact pressure, {:.0} % of the faces' area", 100.0 * share);
            add(&format!("pressure_{word}_kpa"), &long, "kPa", value, None);
        }
        // Receptor and fronts can hide what the paddle itself does.
        let face: Vec<Weighted> = on_paddle
            .iter()
            .filter(|one| !one.is_upright(&axis))
            .map(|one| (one.pressure_kpa(), one.face_area(&axis)))
            .collect();
        let most = face.iter().map(|one| one.0).fold(0.0, f64::max);
        let long = "largest contact pressure on the paddle's face";
        add("paddle_peak_pressure_kpa", long, "kPa", most, None);
        let long = "contact pressure, 95 % of the area of the paddle's face";
        add("paddle_pressure_p95_kpa", long, "kPa", percentile(face, 0.95), None);

        let ComfortPlan { mat_pitch_mm, mat_threshold_kpa, .. } = self.plan;
        let mat = PressureMat::under_paddle(compression, mat_pitch_mm, mat_threshold_kpa);
        let sheet = format!("pressure mat, {mat_pitch_mm} mm, from {mat_threshold_kpa} kPa");
        let area_cm2 = mat.contact_area_mm2() / 100.0;
        add("mat_contact_area_cm2", &format!("{sheet}: contact area"), "cm2", area_cm2, None);
        add("mat_mean_kpa", &format!("{sheet}: mean"), "kPa", mat.mean_kpa(), None);
        add("mat_peak_kpa", &format!("{sheet}: largest"), "kPa", mat.peak_kpa(), None);

        let burden = Burden::of(compression);
        let strains =
            |stretches: &[f64]| stretches.iter().map(|one| one.ln()).collect::<Vec<f64>>();
        let [strain, smallest_strain] =
            [&burden.stretch, &burden.smallest_stretch].map(|s| strains(s));
        for (share, word) in [(0.5, "p50"), (0.95, "p95"), (0.99, "p99")] {
            let percent = 100.0 * share;
            let long = format!("von Mises stress, {percent:.0} % of the volume");
            let value = percentile(burden.by_volume(&burden.von_mises_kpa, None), share);
            add(&format!("von_mises_{word}_kpa"), &long, "kPa", value, None);
            let long = format!("largest logarithmic strain, {percent:.0} % of the volume");
            let value = percentile(burden.by_volume(&strain, None), share);
            add(&format!("strain_{word}"), &long, "", value, None);
            let long = format!("largest principal stress, {percent:.0} % of the volume");
            let value = percentile(burden.by_volume(&burden.largest_stress_kpa, None), share);
            add(&format!("largest_stress_{word}_kpa"), &long, "kPa", value, None);
        }
        for (share, word) in [(0.01, "p01"), (0.05, "p05"), (0.5, "p50")] {
            let long = format!("smallest principal stress, {:.0} % of the volume", 100.0 * share);
            let value = percentile(burden.by_volume(&burden.smallest_stress_kpa, None), share);
            add(&format!("smallest_stress_{word}_kpa"), &long, "kPa", value, None);
            let long = format!("smallest logarithmic strain, {:.0} % of the volume", 100.0 * share);
            let value = percentile(burden.by_volume(&smallest_strain, None), share);
            add(&format!("smallest_strain_{word}"), &long, "", value, None);
        }
        for region in Region::ALL {
            let (name, words) = (region.name(), region.words());
            for (share, word) in [(0.5, "p50"), (0.95, "p95")] {
                let percent = 100.0 * share;
                let long = format!("von Mises stress, {words}, {percent:.0} % of the volume");
                let value =
                    percentile(burden.by_volume(&burden.von_mises_kpa, Some(region)), share);
                add(&format!("von_mises_{name}_{word}_kpa"), &long, "kPa", value, None);
                let long = format!("largest stretch, {words}, {percent:.0} % of the volume");
                let value = percentile(burden.by_volume(&burden.stretch, Some(region)), share);
                add(&format!("stretch_{name}_{word}"), &long, "", value, None);
                let long =
                    format!("largest principal stress, {words}, {percent:.0} % of the volume");
                let values = burden.by_volume(&burden.largest_stress_kpa, Some(region));
                let value = percentile(values, share);
                add(&format!("largest_stress_{name}_{word}_kpa"), &long, "kPa", value, None);
            }
            let long = format!("smallest principal stress, {words}, 5 % of the volume");
            let values = burden.by_volume(&burden.smallest_stress_kpa, Some(region));
            add(
                &format!("smallest_stress_{name}_p05_kpa"),
                &long,
                "kPa",
                percentile(values, 0.05),
                None,
            );
            let long = format!("smallest logarithmic strain, {words}, 5 % of the volume");
            let values = burden.by_volume(&smallest_strain, Some(region));
            let value = percentile(values, 0.05);
            add(&format!("smallest_strain_{name}_p05"), &long, "", value, None);
        }
        Ok(Metrics { metrics, ..Metrics::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::progress::Silent;

    fn metric(compression: &Compression, juxtathoracic_mm: f64, name: &str) -> f64 {
        let plan = ComfortPlan { juxtathoracic_mm, ..ComfortPlan::default() };
        let found = Comfort { plan }.run(compression, &Silent).unwrap().metrics;
        found.iter().find(|metric| metric.name == name).unwrap().value
    }

    /// A square of 40 mm of skin under 2 kPa, nodes each 4 mm from its edge on: the share of the nodes nearer
    /// than a limit is that of their areas.
    #[test]
    fn the_juxtathoracic_share_of_an_even_load_is_that_of_its_area() {
        let mut pressed = mat::tests::pressed();
        for (within_mm, share) in [(20.0, 0.45), (22.0, 0.55), (0.0, 0.0), (100.0, 1.0)] {
            let found = metric(&pressed, within_mm, "juxtathoracic_share");
            assert!((found - share).abs() < 1e-12, "{within_mm} mm: {found}");
        }
        // Twice the force on the nodes within 20 mm: 0.9 of 1.45.
        let points = pressed.solution.points.clone();
        for (force, p) in pressed.plates[1].force_mn.iter_mut().zip(&points) {
            *force *= if p.y < 20.0 { 2.0 } else { 1.0 };
        }
        let found = metric(&pressed, 20.0, "juxtathoracic_share");
        assert!((found - 0.9 / 1.45).abs() < 1e-12, "{found}");
    }

    /// Neither the receptor nor an upright front counts as the paddle's face.
    #[test]
    fn the_face_of_the_paddle_is_apart_from_receptor_and_front() {
        let mut pressed = mat::tests::pressed();
        let touched: Vec<usize> =
            pressed.plates[1].touched().map(|one| one.node as usize).collect();
        assert!(touched.len() > 50);
        let [face, front, receptor] = [touched[3], touched[10], touched[20]];
        let area = |pressed: &Compression, node: usize| pressed.plates[1].area_mm2[node];
        // 5 kPa down; 50 kPa towards the chest wall; 70 kPa under the receptor.
        pressed.plates[1].force_mn[face] = Vec3::new(0.0, 0.0, -5.0 * area(&pressed, face));
        pressed.plates[1].force_mn[front] = Vec3::new(0.0, -50.0 * area(&pressed, front), 0.0);
        pressed.plates[0].force_mn = vec![Vec3::zeros(); pressed.mesh.points.len()];
        pressed.plates[0].area_mm2 = vec![0.0; pressed.mesh.points.len()];
        pressed.plates[0].area_mm2[receptor] = area(&pressed, receptor);
        pressed.plates[0].force_mn[receptor].z = 70.0 * area(&pressed, receptor);
        let found = |name: &str| metric(&pressed, 20.0, name);
        assert!((found("paddle_peak_pressure_kpa") - 5.0).abs() < 1e-12);
        assert!((found("face_peak_pressure_kpa") - 70.0).abs() < 1e-12);
        assert!((found("front_peak_pressure_kpa") - 50.0).abs() < 1e-12);
        // All the rest of the face bears 2 kPa.
        assert!((found("paddle_pressure_p95_kpa") - 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_largest_pressure_has_a_place() {
        let mut pressed = mat::tests::pressed();
        let there = Vec3::new(8.0, 12.0, 30.0);
        let node = pressed.solution.points.iter().position(|p| *p == there).unwrap();
        pressed.contact_pressure_kpa[node] = 9.0;
        for (axis, mm) in ["x", "y", "z"].into_iter().zip(there.iter()) {
            assert_eq!(metric(&pressed, 20.0, &format!("peak_pressure_{axis}_mm")), *mm);
        }
        assert_eq!(metric(&pressed, 20.0, "peak_pressure_juxtathoracic"), 1.0);
        assert_eq!(metric(&pressed, 12.0, "peak_pressure_juxtathoracic"), 0.0);
        pressed.contact_pressure_kpa.fill(0.0);
        assert_eq!(peak(&pressed), None);
    }

    /// Two tetrahedra, one shortened to 0.8 and one to 0.5 of its height and as wide as keeps their volumes: strains
    /// are ln 0.8 and ln 0.5, and those of the sides half of it with the other sign.
    #[test]
    fn the_smallest_strain_is_that_of_the_most_shortened_tissue() {
        let mut pressed = Compression::of_course(crate::compress::Course::default());
        let corners = [[0.0; 3], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], [0.0, 0.0, 6.0]];
        pressed.solution.points = corners.into_iter().map(Vec3::from).collect();
        pressed.mesh.tets = vec![[0, 1, 2, 3]; 2];
        let shortened = |to: f64| {
            let wide = to.sqrt().recip();
            mammotwin_data::Mat3::from_diagonal(&Vec3::new(wide, to, wide))
        };
        pressed.solution.deformation_gradient = vec![shortened(0.8), shortened(0.5)];
        pressed.solution.cauchy_kpa = vec![mammotwin_data::Mat3::zeros(); 2];
        for (name, stretch) in [
            ("smallest_strain_p01", 0.5f64),
            ("smallest_strain_p05", 0.5),
            ("smallest_strain_p50", 0.5),
            ("smallest_strain_rear_p05", 0.5),
            ("strain_p50", 0.8f64.sqrt().recip()),
        ] {
            let found = metric(&pressed, 20.0, name);
            assert!((found - stretch.ln()).abs() < 1e-12, "{name}: {found}");
        }
    }

    #[test]
    fn percentiles_go_by_weight() {
        let values = vec![(3.0, 1.0), (1.0, 8.0), (2.0, 1.0)];
        assert_eq!(percentile(values.clone(), 0.5), 1.0);
        assert_eq!(percentile(values.clone(), 0.85), 2.0);
        assert_eq!(percentile(values, 0.95), 3.0);
    }
}
