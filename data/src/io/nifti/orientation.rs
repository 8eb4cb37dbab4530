//! From a header's affine to a grid in RAS millimetres, and what to call it.
//!
//! A header whose left and right are mirrored looks like any other unless sform and qform
//! contradict each other: else only the picture can tell.

use super::{Refusal, header::Header};
use crate::{Mat3, Vec3, volume::Grid};

/// Letters of the world directions that the voxel axes i, j, k point to most: `RAS`, `LPS`, ...
///
/// Each world axis is given once, the clearest first, so oblique grids have a name too.
pub fn axis_codes(axes: &Mat3) -> String {
    const LETTERS: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['I', 'S']];
    let unit = Mat3::from_columns(
        &[0, 1, 2].map(|c| axes.column(c).try_normalize(0.0).unwrap_or_else(Vec3::zeros)),
    );
    let mut codes = ['?'; 3];
    let mut named_world = [false; 3];
    for _ in 0..3 {
        let mut best = (-1.0, 0, 0);
        for world in (0..3).filter(|&world| !named_world[world]) {
            for voxel in (0..3).filter(|&voxel| codes[voxel] == '?') {
                let share = unit[(world, voxel)].abs();
                if share > best.0 {
                    best = (share, world, voxel);
                }
            }
        }
        let (_, world, voxel) = best;
        named_world[world] = true;
        codes[voxel] = LETTERS[world][usize::from(unit[(world, voxel)] > 0.0)];
    }
    codes.iter().collect()
}

/// Largest angle (rad) between a voxel axis and the world axis that names it.
pub fn obliquity(axes: &Mat3) -> f64 {
    let angle = |column: usize| {
        let unit = axes.column(column).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        unit.amax().min(1.0).acos()
    };
    [0, 1, 2].map(angle).into_iter().fold(0.0, f64::max)
}

/// The grid that a header states, in RAS mm, with what a person should know about it.
///
/// The sform counts before the qform. A header with neither has no orientation and is refused.
pub(super) fn grid(
    header: &Header,
    shape: [usize; 3],
    warnings: &mut Vec<String>,
) -> Result<Grid, Refusal> {
    let scale = millimetres(header.xyzt_units, warnings)?;
    let sform = (header.sform_code > 0).then(|| sform(header)).transpose()?;
    let qform = (header.qform_code > 0).then(|| qform(header));
    let (axes, origin) = match (sform, qform) {
        (Some(s), q) => {
            if let Some(Ok(q)) = q {
                if s.0.determinant() * q.0.determinant() < 0.0 {
                    return Err(Refusal::new(
                        "sform, qform",
                        "are mirror images of each other: left and right of the image are unknown",
                        "set both in a viewer that shows the person's right side",
                    ));
                }
                let apart = (s.0 - q.0).norm().max((s.1 - q.1).norm());
                if !(apart <= 1e-3 * s.0.norm().max(1.0)) {
                    warnings.push("qform and sform disagree: the sform is used".into());
                }
            }
            s
        }
        (None, Some(q)) => q?,
        (None, None) => {
            return Err(Refusal::new(
                "sform_code, qform_code",
                "are both 0: left and right of the image are unknown",
                "set the sform in a viewer that shows the person's right side",
            ));
        }
    };
    let (axes, origin) = (axes * scale, origin * scale);
    let grid = Grid { shape, axes, origin };
    check(&grid, header, scale, warnings)?;
    Ok(grid)
}

/// Millimetres of the header's unit of length.
fn millimetres(xyzt_units: i32, warnings: &mut Vec<String>) -> Result<f64, Refusal> {
    match xyzt_units & 7 {
        1 => Ok(1000.0),
        2 => Ok(1.0),
        3 => Ok(0.001),
        0 => {
            warnings.push("xyzt_units names no unit of length: millimetres are assumed".into());
            Ok(1.0)
        }
        other => Err(Refusal::new(
            "xyzt_units",
            format!("has the unknown unit of length {other}"),
            "set it to 2 (millimetres)",
        )),
    }
}

fn sform(header: &Header) -> Result<(Mat3, Vec3), Refusal> {
    let finite = header.srow.iter().flatten().all(|v| v.is_finite());
    if !finite {
        return Err(Refusal::new(
            "srow_x, srow_y, srow_z",
            "hold a value that is not a number",
            "write the sform anew",
        ));
    }
    let axes = Mat3::from_fn(|row, column| header.srow[row][column]);
    Ok((axes, Vec3::from_fn(|row, _| header.srow[row][3])))
}

/// Method 2 of the NIfTI standard: a rotation by a quaternion, then the voxel sizes.
fn qform(header: &Header) -> Result<(Mat3, Vec3), Refusal> {
    let [b, c, d] = header.quatern;
    let rest = 1.0 - (b * b + c * c + d * d);
    let offset = Vec3::from(header.qoffset);
    if !(rest > -1e-5 && offset.iter().all(|v| v.is_finite())) {
        return Err(Refusal::new(
            "quatern_b, quatern_c, quatern_d, qoffset",
            "are no rotation and position",
            "write the qform anew, or a sform",
        ));
    }
    let pixdim = [1, 2, 3].map(|n| header.pixdim[n]);
    if !pixdim.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(Refusal::new(
            "pixdim",
            format!("is {pixdim:?}, a voxel size must be positive"),
            "write the voxel size in mm, or a sform",
        ));
    }
    let turn = nalgebra::Quaternion::new(rest.max(0.0).sqrt(), b, c, d);
    let turn = nalgebra::UnitQuaternion::from_quaternion(turn).to_rotation_matrix();
    let handed = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let size = Vec3::new(pixdim[0], pixdim[1], pixdim[2] * handed);
    Ok((turn.matrix() * Mat3::from_diagonal(&size), offset))
}

/// Refuses grids that have no volume; tells of grids that look wrong.
fn check(
    grid: &Grid,
    header: &Header,
    scale: f64,
    warnings: &mut Vec<String>,
) -> Result<(), Refusal> {
    let spacing = grid.spacing_mm();
    let block = spacing.iter().product::<f64>();
    let sound = block.is_normal() && grid.axes.determinant().abs() > 1e-3 * block;
    if !(sound && grid.origin.norm().is_finite()) {
        return Err(Refusal::new(
            "srow_x, srow_y, srow_z",
            "are no affine with a volume: two voxel axes are parallel, or one has no length",
            "write the affine anew",
        ));
    }
    let apart = |n: usize| (header.pixdim[n + 1] * scale / spacing[n] - 1.0).abs();
    if !(0..3).all(|n| apart(n) < 0.01) {
        warnings.push(format!(
            "pixdim {:?} and the affine's spacing {spacing:.4?} mm disagree: the affine is used",
            [1, 2, 3].map(|n| header.pixdim[n])
        ));
    }
    if !spacing.iter().all(|s| (0.05..20.0).contains(s)) {
        warnings.push(format!("a spacing of {spacing:.4?} mm is unusual: check xyzt_units"));
    }
    let [a, b, c] = [0, 1, 2].map(|n| grid.axes.column(n).normalize());
    if a.dot(&b).abs().max(a.dot(&c).abs()).max(b.dot(&c).abs()) > 0.01 {
        warnings.push("the voxel axes are not perpendicular".into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_named_like_nibabel_does() {
        let check = |m: [f64; 9], name: &str| {
            assert_eq!(axis_codes(&Mat3::from_row_slice(&m)), name);
        };
        check([1., 0., 0., 0., 2., 0., 0., 0., 3.], "RAS");
        check([-1., 0., 0., 0., -2., 0., 0., 0., 3.], "LPS");
        check([0., 0., 1., -1., 0., 0., 0., 2., 0.], "PSR");
        // 48 degrees about z: j is nearer to left than i is to anterior.
        let (s, c) = (48f64.to_radians().sin(), 48f64.to_radians().cos());
        check([c, -s, 0., s, c, 0., 0., 0., 1.], "ALS");
    }

    #[test]
    fn obliquity_is_the_angle_of_the_turn() {
        let turn = *nalgebra::Rotation3::new(Vec3::new(0.0, 0.0, 0.2)).matrix();
        assert!((obliquity(&(turn * 1.7)) - 0.2).abs() < 1e-12);
    }
}
