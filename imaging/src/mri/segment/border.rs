//! Whether the breasts lie wholly in the image.

use super::error::{Border, SegmentError, Warning};
use super::frame::Frame;
use super::limits::{BodyLimits, slot};
use mammotwin_data::Vec3;
use mammotwin_data::labels::{LabelMap, Side};

/// A cross-section at the upper or lower border above this part of the largest: a cut breast.
const CUT_FRACTION: f64 = 0.75;
/// Above this part, it deserves a warning.
const ENDS_FRACTION: f64 = 0.2;
/// Area (mm²) of breast on the front border that means a cut breast.
const CUT_FRONT_MM2: f64 = 500.0;
/// The same on the borders at the sides, where the flank may touch.
const CUT_SIDE_MM2: f64 = 3000.0;
/// The flank ends this far (mm) in front of the lateral plane.
const FLANK_MM: f64 = 40.0;

/// Refuses breasts that the upper or lower border cuts, and warns of those that end there.
pub(super) fn check_heights(limits: &BodyLimits) -> Result<Vec<Warning>, SegmentError> {
    let mut warnings = Vec::new();
    for side in [Side::Right, Side::Left] {
        let at_border = limits.at_border[slot(side)];
        for (border, fraction) in [Border::Inferior, Border::Superior].into_iter().zip(at_border) {
            if fraction > CUT_FRACTION {
                return Err(SegmentError::BreastCut { side, border });
            }
            if fraction > ENDS_FRACTION {
                warnings.push(Warning::EndsAtBorder { side, border, percent: 100.0 * fraction });
            }
        }
    }
    Ok(warnings)
}

/// Refuses breasts that the front border or a border at the side cuts.
pub(super) fn check_faces(
    labels: &LabelMap,
    frame: &Frame,
    limits: &BodyLimits,
) -> Result<(), SegmentError> {
    let grid = &labels.grid;
    for axis in 0..3 {
        let step: Vec3 = frame.body_from_voxel.linear.column(axis).into_owned();
        let others = [(axis + 1) % 3, (axis + 2) % 3];
        let columns = others.map(|a| frame.body_from_voxel.linear.column(a).into_owned());
        let face_mm2 = columns[0].cross(&columns[1]).norm();
        for (end, sign) in [(0, -1.0), (grid.shape[axis] - 1, 1.0)] {
            let outward = sign * step.normalize();
            let (border, allowed, from_y) = if outward.y > 0.7 {
                (Border::Anterior, CUT_FRONT_MM2, limits.lateral_y)
            } else if outward.x.abs() > 0.7 {
                (Border::Lateral, CUT_SIDE_MM2, limits.lateral_y + FLANK_MM)
            } else {
                continue;
            };
            let mut area = [0.0; 2];
            for a in 0..grid.shape[others[0]] {
                for b in 0..grid.shape[others[1]] {
                    let mut voxel = [0; 3];
                    voxel[axis] = end;
                    voxel[others[0]] = a;
                    voxel[others[1]] = b;
                    if labels.at(voxel).is_breast() {
                        let p = frame.body_from_voxel.apply(&Vec3::from(voxel.map(|v| v as f64)));
                        if p.y > from_y {
                            area[usize::from(limits.right_of_sternum(p.x, p.z) < 0.0)] += face_mm2;
                        }
                    }
                }
            }
            for side in [Side::Right, Side::Left] {
                if area[slot(side)] > allowed {
                    return Err(SegmentError::BreastCut { side, border });
                }
            }
        }
    }
    Ok(())
}
