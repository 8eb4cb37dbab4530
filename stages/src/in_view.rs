//! How much of the breast a mammogram shows.

use crate::{compress::Compression, mesh::BreastMesh};
use mammotwin_data::{Vec3, mesh::TetMesh};
use mammotwin_imaging::xray::geometry::Geometry;
use mammotwin_solver::mesh::crop::crop;

/// Tissue of the breast, compressed, that casts its shadow on the detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InView {
    /// Its volume (cm³).
    pub volume_cm3: f64,
    /// Its share of the breast, which is what lay within the base of the breast in the reference pose.
    pub share: f64,
}

/// How often an element on the border of the picture is cut into eight.
const CUTS: u32 = 3;

/// What is in view of a breast.
///
/// The fat between and beside the breasts, which the mesh holds too, does not count. `None` when the mesh
/// is not the one that was compressed, or has no such breast.
pub fn in_view(
    mesh: &BreastMesh,
    compression: &Compression,
    geometry: &Geometry,
) -> Option<InView> {
    let base = mesh.anatomy.breast(compression.side)?;
    let part = crop(&mesh.corners(), compression.side, mesh.anatomy.sternum_x_mm, 0.0).mesh;
    if part.tets != compression.mesh.tets {
        return None;
    }
    let points = &compression.solution.points;
    let (mut seen, mut all) = (0.0, 0.0);
    for tet in &part.tets {
        let middle = tet.iter().map(|n| part.points[*n as usize]).sum::<Vec3>() / 4.0;
        if base.radius(&middle) > 1.0 {
            continue;
        }
        let volume = TetMesh::tet_volume(points, tet);
        all += volume;
        seen += volume * shown(&tet.map(|n| points[n as usize]), geometry, CUTS);
    }
    (all > 0.0).then(|| InView { volume_cm3: seen / 1000.0, share: seen / all })
}

/// By how much (mm) the shadow of a point lies beyond each side of the detector.
fn beyond(point: &Vec3, geometry: &Geometry) -> [f64; 4] {
    let [x, y] = geometry.shadow_mm(point);
    let half = 0.5 * geometry.columns as f64 * geometry.pitch_mm;
    [-y, y - geometry.rows as f64 * geometry.pitch_mm, -half - x, x - half]
}

/// Share of a tetrahedron whose shadow lies on the detector.
fn shown(corners: &[Vec3; 4], geometry: &Geometry, cuts: u32) -> f64 {
    let sides = corners.map(|corner| beyond(&corner, geometry));
    // What the detector sees is convex: all of it, or nothing of it beyond one side.
    if sides.iter().flatten().all(|side| *side <= 0.0) {
        return 1.0;
    }
    if (0..4).any(|side| sides.iter().all(|corner| corner[side] > 0.0)) {
        return 0.0;
    }
    if cuts == 0 {
        let middle = corners.iter().sum::<Vec3>() / 4.0;
        return f64::from(u8::from(beyond(&middle, geometry).iter().all(|side| *side <= 0.0)));
    }
    let [a, b, c, d] = *corners;
    let half = |p: Vec3, q: Vec3| 0.5 * (p + q);
    let [ab, ac, ad] = [half(a, b), half(a, c), half(a, d)];
    let [bc, bd, cd] = [half(b, c), half(b, d), half(c, d)];
    let parts = [
        [a, ab, ac, ad],
        [b, ab, bc, bd],
        [c, ac, bc, cd],
        [d, ad, bd, cd],
        [ab, cd, ac, ad],
        [ab, cd, ad, bd],
        [ab, cd, bd, bc],
        [ab, cd, bc, ac],
    ];
    parts.iter().map(|part| shown(part, geometry, cuts - 1)).sum::<f64>() / 8.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(at: [f64; 3], size: f64) -> [Vec3; 4] {
        let at = Vec3::from(at);
        [at, at + Vec3::x() * size, at + Vec3::y() * size, at + Vec3::z() * size]
    }

    #[test]
    fn a_tetrahedron_is_in_view_out_of_it_or_cut_by_the_chest_wall_edge() {
        let detector = Geometry::pristina(0.5);
        assert_eq!(shown(&corner([0.0, 10.0, 5.0], 20.0), &detector, CUTS), 1.0);
        assert_eq!(shown(&corner([0.0, -30.0, 5.0], 20.0), &detector, CUTS), 0.0);
        assert_eq!(shown(&corner([200.0, 10.0, 5.0], 20.0), &detector, CUTS), 0.0);
        // The edge of the detector cuts off a similar one with half the edges.
        let part = shown(&corner([0.0, -10.0, 5.0], 20.0), &detector, CUTS);
        assert!((part - 0.125).abs() < 0.02, "{part}");
        let finer = shown(&corner([0.0, -10.0, 5.0], 20.0), &detector, 6);
        assert!((finer - 0.125).abs() < 0.003, "{finer}");
    }

    #[test]
    fn what_is_high_casts_its_shadow_beyond_the_side() {
        let detector = Geometry::pristina(0.5);
        // 140 mm beside the middle, 60 mm high: magnified to 154 mm, the detector ends at 142.5.
        assert_eq!(shown(&corner([140.0, 10.0, 60.0], 1.0), &detector, CUTS), 0.0);
        assert_eq!(shown(&corner([140.0, 10.0, 1.0], 1.0), &detector, CUTS), 1.0);
    }
}
