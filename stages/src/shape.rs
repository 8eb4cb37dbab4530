//! Nodes of a skin, and what rigid motions do to distances from it.

use mammotwin_data::{Failure, Vec3, io::hdf5, surface::TriMesh};
use nalgebra::{DMatrix, DVector};

/// Some nodes of the skin in one shape of the body.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Positions (mm).
    pub points: Vec<Vec3>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
}

/// Change of the chest wall between poses, along each axis (mm), and the length (mm) over which it is alike: 1 - 2.4 mm rms over
/// waves of 160 - 320 mm is what people differ by (Mîra 2018, § 3.1; measured ±5 mm).
pub(crate) const CHEST_MM: f64 = 1.05;
pub(crate) const CHEST_LENGTH_MM: f64 = 60.0;

impl Shape {
    /// Some nodes of a skin.
    pub fn of(skin: &TriMesh, nodes: &[u32]) -> Self {
        let normals = skin.vertex_normals();
        Self {
            points: nodes.iter().map(|&n| skin.points[n as usize]).collect(),
            normals: nodes.iter().map(|&n| normals[n as usize]).collect(),
        }
    }

    /// Writes into a group.
    pub(crate) fn put(&self, file: &mut hdf5::Writer, group: &str) -> Result<(), Failure> {
        file.put(&format!("{group}/points"), &self.points, "mm", "nodes of the skin")?;
        file.put(&format!("{group}/normals"), &self.normals, "1", "outward unit normals")?;
        Ok(())
    }

    /// Reads what [`Shape::put`] wrote.
    pub(crate) fn get(file: &hdf5::Reader, group: &str) -> Result<Self, Failure> {
        let points = file.get(&format!("{group}/points"))?;
        Ok(Self { points, normals: file.get(&format!("{group}/normals"))? })
    }

    /// Correlation of the distances that smooth displacements make along the normals: displacements are alike over a
    /// length (mm).
    pub(crate) fn alike(&self, length_mm: f64) -> DMatrix<f64> {
        let nodes = self.points.len();
        DMatrix::from_fn(nodes, nodes, |i, j| self.alike_of(i, j, length_mm))
    }

    /// The same of two nodes.
    pub(crate) fn alike_of(&self, i: usize, j: usize, length_mm: f64) -> f64 {
        let far = (self.points[i] - self.points[j]).norm_squared();
        (-0.5 * far / (length_mm * length_mm)).exp() * self.normals[i].dot(&self.normals[j])
    }

    /// What small translations (1 mm) and turns (1 rad about the centre) of the measured skin add to
    /// the residuals.
    pub fn rigid_modes(&self) -> [DVector<f64>; 6] {
        let center = self.points.iter().sum::<Vec3>() / self.points.len().max(1) as f64;
        std::array::from_fn(|mode| {
            let one = |(p, n): (&Vec3, &Vec3)| match mode {
                0..3 => n[mode],
                _ => (p - center).cross(n)[mode - 3],
            };
            DVector::from_iterator(
                self.points.len(),
                self.points.iter().zip(&self.normals).map(one),
            )
        })
    }

    /// Root mean square (mm) of residuals after the rigid motion that makes it least.
    pub fn without_rigid_mm(&self, residual: &DVector<f64>) -> f64 {
        let left = residual - self.rigid_part(residual);
        (left.norm_squared() / left.len().max(1) as f64).sqrt()
    }

    /// The part of residuals that a rigid motion explains (mm).
    pub fn rigid_part(&self, residual: &DVector<f64>) -> DVector<f64> {
        let basis = DMatrix::from_columns(&self.rigid_modes()).qr().q();
        &basis * (basis.transpose() * residual)
    }
}
