//! Distance of a point from the plane of a face, all of which move.
//!
//! With e = b - a, f = c - a, r = x - a, N = e × f and A = |N| the distance is d = V / A, V = N·r. Its
//! derivatives by (e, f, r) are those of V, which is linear in each, and of A.

use mammotwin_data::{Mat3, Vec3};

/// A distance with its derivatives by the point and the corners of the face, in this order.
pub(super) struct Distance {
    /// Distance (mm), positive on the side of the normal.
    pub mm: f64,
    /// Its gradient; the first is the normal of the face.
    pub gradient: [Vec3; 4],
    /// Its second derivatives (1/mm).
    pub curvature: [[Mat3; 4]; 4],
}

/// Distance (mm) of a point from the plane of a face, along its normal.
pub(super) fn distance_mm([x, a, b, c]: &[Vec3; 4]) -> f64 {
    let normal = (b - a).cross(&(c - a));
    normal.dot(&(x - a)) / normal.norm().max(f64::MIN_POSITIVE)
}

/// Barycentric coordinates of a point's foot on a face.
pub(super) fn foot([x, a, b, c]: &[Vec3; 4]) -> [f64; 3] {
    let normal = (b - a).cross(&(c - a));
    let size = normal.norm_squared().max(f64::MIN_POSITIVE);
    let part = |from: &Vec3, to: &Vec3| (to - from).cross(&(x - from)).dot(&normal) / size;
    [part(b, c), part(c, a), part(a, b)]
}

/// The distance of the first of four points from the face of the others, with its derivatives; `None` for a
/// face without area.
pub(super) fn distance([x, a, b, c]: &[Vec3; 4]) -> Option<Distance> {
    let (e, f, r) = (b - a, c - a, x - a);
    let cross = e.cross(&f);
    let area = cross.norm();
    if !(area > 0.0) {
        return None;
    }
    let normal = cross / area;
    let volume = cross.dot(&r);
    let mm = volume / area;
    let of_volume = [f.cross(&r), r.cross(&e), cross];
    let of_area = [f.cross(&normal), normal.cross(&e), Vec3::zeros()];
    let slope = |n: usize| (of_volume[n] - mm * of_area[n]) / area;
    let own = [0, 1, 2].map(slope);

    let [skew_e, skew_f, skew_r] = [e, f, r].map(|v: Vec3| v.cross_matrix());
    let across = (Mat3::identity() - normal * normal.transpose()) / area;
    let none = Mat3::zeros();
    // Row by row, the lower triangle is the transpose of the upper.
    let volumes = [[none, -skew_r, skew_f], [none, none, -skew_e], [none, none, none]];
    let areas = [
        [-skew_f * across * skew_f, skew_f * across * skew_e - normal.cross_matrix(), none],
        [none, -skew_e * across * skew_e, none],
        [none, none, none],
    ];
    let second = |m: usize, n: usize| {
        let mixed = of_area[m] * own[n].transpose() + own[m] * of_area[n].transpose();
        (volumes[m][n] - mm * areas[m][n] - mixed) / area
    };
    let mut by_edges = [[none; 3]; 3];
    for m in 0..3 {
        for n in m..3 {
            by_edges[m][n] = second(m, n);
            by_edges[n][m] = by_edges[m][n].transpose();
        }
    }
    // How (e, f, r) move with the point and the corners.
    const SIGNS: [[f64; 3]; 4] = [[0., 0., 1.], [-1., -1., -1.], [1., 0., 0.], [0., 1., 0.]];
    let gradient = SIGNS.map(|signs| (0..3).map(|n| signs[n] * own[n]).sum());
    let between = |one: [f64; 3], two: [f64; 3]| {
        let pairs = (0..9).map(|k| (k / 3, k % 3));
        pairs.map(|(m, n)| one[m] * two[n] * by_edges[m][n]).sum::<Mat3>()
    };
    Some(Distance { mm, gradient, curvature: SIGNS.map(|one| SIGNS.map(|two| between(one, two))) })
}
