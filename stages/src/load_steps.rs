//! The states on the way of a compression, for pictures and other programs.

use mammotwin_data::{
    Failure, Vec3,
    io::hdf5::{Reader, Writer},
    rigid::RigidTransform,
};
use mammotwin_solver::compress::Step;

/// One state: what is looked at, in single precision. The last one is the end of the compression.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoadStep {
    /// Node positions (mm).
    pub points: Vec<[f32; 3]>,
    /// Contact pressure of the plates at the nodes (kPa).
    pub contact_pressure_kpa: Vec<f32>,
    /// Von Mises stress in the tetrahedra (kPa).
    pub von_mises_kpa: Vec<f32>,
    /// Heights (mm, z of the detector at the end) of the plates at their chest-wall edge: receptor,
    /// paddle.
    pub plates_mm: [f64; 2],
}

impl LoadStep {
    /// A recorded state, its points moved into the frame of the detector. `origin_mm` is the place
    /// of the receptor at the end, `edge_mm` by how much the paddle's tilt and bending lift its edge.
    pub fn of(step: &Step, to_detector: &RigidTransform, origin_mm: f64, edge_mm: f64) -> Self {
        let receptor = step.receptor_mm - origin_mm;
        let paddle = receptor + step.thickness_mm + edge_mm;
        let single = |values: &[f64]| values.iter().map(|&v| v as f32).collect();
        Self {
            points: step.points.iter().map(|p| narrow(&to_detector.point(p))).collect(),
            contact_pressure_kpa: single(&step.contact_pressure_kpa),
            von_mises_kpa: single(&step.von_mises_kpa),
            plates_mm: [receptor, paddle],
        }
    }

    /// The same state with its points in another frame.
    pub fn moved(&self, motion: &RigidTransform) -> Self {
        let points =
            self.points.iter().map(|p| narrow(&motion.point(&Vec3::from(p.map(f64::from)))));
        Self { points: points.collect(), ..self.clone() }
    }
}

fn narrow(point: &Vec3) -> [f32; 3] {
    [point.x as f32, point.y as f32, point.z as f32]
}

/// Writes states of one mesh: `points` (s, n, 3), `contact_pressure_kpa` (s, n), `von_mises_kpa`
/// (s, m), `plates_mm` (s, 2).
///
/// # Panics
/// When the states are not all of one mesh.
pub fn put(file: &mut Writer, group: &str, steps: &[LoadStep]) -> Result<(), Failure> {
    let Some(first) = steps.first() else { return Ok(()) };
    let (nodes, cells) = (first.points.len(), first.von_mises_kpa.len());
    let points: Vec<f32> = steps.iter().flat_map(|s| s.points.as_flattened()).copied().collect();
    let long_name = "Node positions at each load step";
    let shape = [steps.len(), nodes, 3];
    file.put_array(&format!("{group}/points"), &shape, &points, "mm", long_name)?;
    let plates: Vec<[f64; 2]> = steps.iter().map(|s| s.plates_mm).collect();
    let long_name = "Heights of receptor and paddle at their chest-wall edge, z of the detector";
    file.put(&format!("{group}/plates_mm"), &plates, "mm", long_name)?;
    let mut put = |name: &str, long: &str, columns: usize, of: fn(&LoadStep) -> &[f32]| {
        let values: Vec<f32> = steps.iter().flat_map(of).copied().collect();
        file.put_array(&format!("{group}/{name}"), &[steps.len(), columns], &values, "kPa", long)
    };
    let long = "Contact pressure at each load step";
    put("contact_pressure_kpa", long, nodes, |s| &s.contact_pressure_kpa)?;
    put("von_mises_kpa", "Von Mises stress at each load step", cells, |s| &s.von_mises_kpa)?;
    Ok(())
}

/// Reads what [`put`] wrote.
pub fn get(file: &Reader, group: &str) -> Result<Vec<LoadStep>, Failure> {
    if !file.has(&format!("{group}/points")) {
        return Ok(Vec::new());
    }
    let (shape, points) = file.array::<f32>(&format!("{group}/points"))?;
    let (_, pressures) = file.array::<f32>(&format!("{group}/contact_pressure_kpa"))?;
    let (_, stresses) = file.array::<f32>(&format!("{group}/von_mises_kpa"))?;
    let plates: Vec<[f64; 2]> = file.get(&format!("{group}/plates_mm"))?;
    let count = shape.first().copied().unwrap_or(0).max(1);
    let part = |values: &[f32], n: usize| {
        let size = values.len() / count;
        values[n * size..(n + 1) * size].to_vec()
    };
    let step = |n| LoadStep {
        points: part(&points, n).chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect(),
        contact_pressure_kpa: part(&pressures, n),
        von_mises_kpa: part(&stresses, n),
        plates_mm: plates.get(n).copied().unwrap_or_default(),
    };
    Ok((0..count).map(step).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_come_back() {
        let step = |shift: f32| LoadStep {
            points: vec![[shift, 1.0, 2.0], [3.0, 4.0, shift]],
            contact_pressure_kpa: vec![shift, 0.5],
            von_mises_kpa: vec![shift * 2.0, 1.0, 0.25],
            plates_mm: [f64::from(shift), 50.0],
        };
        let steps = vec![step(0.1), step(0.2), step(7.5)];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.h5");
        let mut file = Writer::create(&path).unwrap();
        put(&mut file, "steps", &steps).unwrap();
        file.finish().unwrap();
        let file = Reader::open(&path).unwrap();
        assert_eq!(get(&file, "steps").unwrap(), steps);
        assert!(get(&file, "none").unwrap().is_empty());
    }
}
