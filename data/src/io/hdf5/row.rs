//! What one row of a dataset may be: a number, a point, a matrix, the corners of an element.

use crate::{Mat3, Vec3};
use ::hdf5::H5Type;

/// A number that HDF5 keeps as it is.
pub trait Element: H5Type + Copy + Default {}

impl Element for f32 {}
impl Element for f64 {}
impl Element for i32 {}
impl Element for i64 {}
impl Element for u8 {}
impl Element for u16 {}
impl Element for u32 {}
impl Element for u64 {}

/// One row of a dataset; `n` rows make the shape `(n, SHAPE..)`.
pub trait Row: Copy {
    /// The numbers in it.
    type Element: Element;
    /// Shape of one row; empty for a plain number.
    const SHAPE: &'static [usize];
    /// Appends the numbers of the row, last index fastest.
    fn flatten(&self, out: &mut Vec<Self::Element>);
    /// The row from as many numbers as its shape has.
    fn from_flat(flat: &[Self::Element]) -> Self;
}

impl<T: Element> Row for T {
    type Element = T;
    const SHAPE: &'static [usize] = &[];

    fn flatten(&self, out: &mut Vec<T>) {
        out.push(*self);
    }

    fn from_flat(flat: &[T]) -> Self {
        flat[0]
    }
}

macro_rules! row_of_array {
    ($element:ty, $n:literal) => {
        impl Row for [$element; $n] {
            type Element = $element;
            const SHAPE: &'static [usize] = &[$n];

            fn flatten(&self, out: &mut Vec<$element>) {
                out.extend_from_slice(self);
            }

            fn from_flat(flat: &[$element]) -> Self {
                std::array::from_fn(|i| flat[i])
            }
        }
    };
}

row_of_array!(u32, 2);
row_of_array!(u32, 3);
row_of_array!(u32, 4);
row_of_array!(f64, 2);
row_of_array!(f64, 3);

impl Row for Vec3 {
    type Element = f64;
    const SHAPE: &'static [usize] = &[3];

    fn flatten(&self, out: &mut Vec<f64>) {
        out.extend_from_slice(self.as_slice());
    }

    fn from_flat(flat: &[f64]) -> Self {
        Self::new(flat[0], flat[1], flat[2])
    }
}

impl Row for Mat3 {
    type Element = f64;
    const SHAPE: &'static [usize] = &[3, 3];

    fn flatten(&self, out: &mut Vec<f64>) {
        // Row by row, as readers of C order expect; nalgebra keeps columns.
        out.extend_from_slice(self.transpose().as_slice());
    }

    fn from_flat(flat: &[f64]) -> Self {
        Self::from_row_slice(flat)
    }
}
