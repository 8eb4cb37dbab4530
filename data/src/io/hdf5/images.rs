//! Volumes, label maps and radiographs in a group.

use super::{Element, Hdf5Error, Reader, Writer};
use crate::{
    Mat3, Vec3,
    labels::{LabelMap, Tissue},
    radiograph::Radiograph,
    volume::{Grid, Volume},
};

impl Writer {
    /// Writes a volume: `values` of shape (k, j, i), `axes`, `origin`.
    pub fn put_volume<T: Element>(
        &mut self,
        group: &str,
        volume: &Volume<T>,
        units: &str,
        long_name: &str,
    ) -> Result<(), Hdf5Error> {
        let Grid { shape: [ni, nj, nk], axes, origin } = &volume.grid;
        let (name, shape) = (format!("{group}/values"), [*nk, *nj, *ni]);
        self.put_array(&name, &shape, &volume.values, units, long_name)?;
        let long_name = "World steps of one voxel along i, j, k, as columns, RAS";
        self.put(&format!("{group}/axes"), &rows(axes), "mm", long_name)?;
        let long_name = "Centre of voxel (0, 0, 0), RAS";
        self.put(&format!("{group}/origin"), origin.as_slice(), "mm", long_name)
    }

    /// Writes a label map as a volume of label values.
    pub fn put_labels(&mut self, group: &str, labels: &LabelMap) -> Result<(), Hdf5Error> {
        self.put_volume(group, &labels.map(Tissue::label), "1", "Tissue labels")
    }

    /// Writes a radiograph: `pixels` of shape (rows, columns), and where they are.
    pub fn put_radiograph(&mut self, group: &str, picture: &Radiograph) -> Result<(), Hdf5Error> {
        let at = |name: &str| format!("{group}/{name}");
        let shape = [picture.rows, picture.columns];
        // The unit is in the quantity's own words: "path length (mm)".
        let unit = picture.quantity.split_once('(').and_then(|(_, rest)| rest.split_once(')'));
        let unit = unit.map_or("1", |(unit, _)| unit);
        self.put_array(&at("pixels"), &shape, &picture.pixels, unit, &picture.quantity)?;
        self.put_scalar(&at("pitch_mm"), picture.pitch_mm, "mm", "Distance of pixel centres")?;
        self.put_scalar(&at("left_mm"), picture.left_mm, "mm", "x of the centre of column 0")?;
        let long_name = "Distance of the centre of row 0 from the chest-wall edge";
        self.put_scalar(&at("first_row_mm"), picture.first_row_mm, "mm", long_name)
            .and_then(|()| self.put_text(&at("quantity"), &picture.quantity, "What a pixel says"))
    }
}

impl Reader {
    /// Reads what [`Writer::put_volume`] wrote.
    pub fn volume<T: Element>(&self, group: &str) -> Result<Volume<T>, Hdf5Error> {
        let (shape, values) = self.array(&format!("{group}/values"))?;
        let &[nk, nj, ni] = shape.as_slice() else {
            return Err(self.invalid(group, format!("values have shape {shape:?}, not (k, j, i)")));
        };
        let axes: Vec<[f64; 3]> = self.get(&format!("{group}/axes"))?;
        let origin: Vec<f64> = self.get(&format!("{group}/origin"))?;
        let ([a, b, c], [x, y, z]) = (axes.as_slice(), origin.as_slice()) else {
            return Err(self.invalid(group, "axes are not 3 x 3, or origin is not of length 3"));
        };
        let axes = Mat3::from_row_slice(&[*a, *b, *c].concat());
        if axes.try_inverse().is_none() {
            return Err(self.invalid(group, "axes are singular"));
        }
        let grid = Grid { shape: [ni, nj, nk], axes, origin: Vec3::new(*x, *y, *z) };
        Ok(Volume { grid, values })
    }

    /// Reads what [`Writer::put_labels`] wrote; labels are checked.
    pub fn labels(&self, group: &str) -> Result<LabelMap, Hdf5Error> {
        let Volume { grid, values } = self.volume::<u8>(group)?;
        let tissue = |&label: &u8| {
            Tissue::from_label(label)
                .ok_or_else(|| self.invalid(group, format!("no tissue has label {label}")))
        };
        let values = values.iter().map(tissue).collect::<Result<_, _>>()?;
        Ok(Volume { grid, values })
    }

    /// Reads what [`Writer::put_radiograph`] wrote.
    pub fn radiograph(&self, group: &str) -> Result<Radiograph, Hdf5Error> {
        let at = |name: &str| format!("{group}/{name}");
        let (shape, pixels) = self.array(&at("pixels"))?;
        let &[rows, columns] = shape.as_slice() else {
            let why = format!("pixels have shape {shape:?}, not (rows, columns)");
            return Err(self.invalid(group, why));
        };
        Ok(Radiograph {
            columns,
            rows,
            pitch_mm: self.scalar(&at("pitch_mm"))?,
            left_mm: self.scalar(&at("left_mm"))?,
            first_row_mm: self.scalar(&at("first_row_mm"))?,
            pixels,
            quantity: self.text(&at("quantity"))?,
        })
    }
}

/// Rows of a matrix.
fn rows(matrix: &Mat3) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}
