//! Shape of tetrahedra (Mîra 2018, § 2.2.2).

use mammotwin_data::{Vec3, mesh::TetMesh};
use rayon::prelude::*;

/// Shape of one tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Shape {
    /// 0 for the regular tetrahedron, 1 for a flat one, above 1 for an inverted one: what the
    /// volume lacks to that of the regular tetrahedron with the same circumsphere (§ 2.2.2).
    pub skewness: f64,
    /// 1 for the regular tetrahedron: the worst over faces and cross-sections.
    pub aspect_ratio: f64,
    /// Largest corner angle (deg) over faces and cross-sections; 60 for a regular one is the best
    /// face, its cross-sections have 70.5.
    pub max_angle_deg: f64,
    /// Smallest scaled Jacobian: `√2 · 6 V` over the largest product of the three edges at a
    /// corner. 1 for the regular tetrahedron.
    pub scaled_jacobian: f64,
}

/// Shape of all tetrahedra of a mesh.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Quality {
    /// In the order of the tetrahedra.
    pub shapes: Vec<Shape>,
    /// What they come to.
    pub summary: Summary,
}

/// The worst and the mean.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Summary {
    /// Number of tetrahedra.
    pub tets: usize,
    /// Mean skewness.
    pub mean_skewness: f64,
    /// Largest skewness.
    pub max_skewness: f64,
    /// Number of tetrahedra over skewness 0.75: bad quality (§ 2.2.2).
    pub over_075: usize,
    /// Number of tetrahedra over skewness 0.95.
    pub over_095: usize,
    /// Largest aspect ratio; 20 is the limit (§ 2.2.2).
    pub max_aspect_ratio: f64,
    /// Largest corner angle (deg); 165 is the limit (§ 2.2.2).
    pub max_angle_deg: f64,
    /// Smallest scaled Jacobian.
    pub min_scaled_jacobian: f64,
    /// Smallest volume of a tetrahedron (mm³).
    pub min_volume_mm3: f64,
}

/// Measures the tetrahedra with the nodes at `points`: of the mesh, or of a deformed state.
pub fn quality(points: &[Vec3], tets: &[[u32; 4]]) -> Quality {
    let measure = |tet: &[u32; 4]| shape(&tet.map(|n| points[n as usize]));
    let shapes: Vec<Shape> = tets.par_iter().map(measure).collect();
    let mut summary = Summary {
        tets: tets.len(),
        min_scaled_jacobian: f64::INFINITY,
        min_volume_mm3: f64::INFINITY,
        ..Summary::default()
    };
    for (shape, tet) in shapes.iter().zip(tets) {
        summary.mean_skewness += shape.skewness / tets.len() as f64;
        summary.max_skewness = summary.max_skewness.max(shape.skewness);
        summary.over_075 += usize::from(shape.skewness > 0.75);
        summary.over_095 += usize::from(shape.skewness > 0.95);
        summary.max_aspect_ratio = summary.max_aspect_ratio.max(shape.aspect_ratio);
        summary.max_angle_deg = summary.max_angle_deg.max(shape.max_angle_deg);
        summary.min_scaled_jacobian = summary.min_scaled_jacobian.min(shape.scaled_jacobian);
        let volume = TetMesh::tet_volume(points, tet);
        summary.min_volume_mm3 = summary.min_volume_mm3.min(volume);
    }
    Quality { shapes, summary }
}

/// Volume over that of the regular tetrahedron with the same circumsphere: 1 minus the skewness.
/// Negative when inverted.
///
/// With edges a, b, c from one corner, `D = a·(b×c)` and the circumradius
/// `R = ‖a²(b×c) + b²(c×a) + c²(a×b)‖ / 2D`, it is `(D/6) / (8√3/27 R³)`.
pub fn equivolume(corners: &[Vec3; 4]) -> f64 {
    let [o, a, b, c] = corners;
    let (a, b, c) = (a - o, b - o, c - o);
    let (bc, ca, ab) = (b.cross(&c), c.cross(&a), a.cross(&b));
    let determinant = a.dot(&bc);
    let sum = a.norm_squared() * bc + b.norm_squared() * ca + c.norm_squared() * ab;
    let cube = sum.norm_squared() * sum.norm();
    if cube == 0.0 {
        return 0.0;
    }
    // (D/6) / (8√3/27) · (2D)³ = (3√3/2) D⁴, with the sign of D.
    let power = determinant * determinant * determinant.abs() * determinant;
    1.5 * 3f64.sqrt() * power / cube
}

/// All measures of one tetrahedron.
pub fn shape(corners: &[Vec3; 4]) -> Shape {
    let mut aspect_ratio = 1.0f64;
    let mut angle = 0.0f64;
    for triangle in sections(corners) {
        aspect_ratio = aspect_ratio.max(triangle_aspect_ratio(&triangle));
        angle = angle.max(triangle_max_angle(&triangle));
    }
    let [a, b, c, d] = corners;
    let volume6 = (b - a).dot(&(c - a).cross(&(d - a)));
    let product = |n: usize| {
        let others = (0..4).filter(|&m| m != n);
        others.map(|m| (corners[m] - corners[n]).norm()).product::<f64>()
    };
    let largest = (0..4).map(product).fold(0.0, f64::max);
    Shape {
        skewness: 1.0 - equivolume(corners),
        aspect_ratio,
        max_angle_deg: angle.to_degrees(),
        scaled_jacobian: 2f64.sqrt() * volume6 / largest,
    }
}

/// The four faces, and the six cross-sections through an edge and the middle of the opposite one.
fn sections(corners: &[Vec3; 4]) -> [[Vec3; 3]; 10] {
    let [a, b, c, d] = *corners;
    let middle = |p: Vec3, q: Vec3| 0.5 * (p + q);
    [
        [a, b, c],
        [a, b, d],
        [a, c, d],
        [b, c, d],
        [a, b, middle(c, d)],
        [a, c, middle(b, d)],
        [a, d, middle(b, c)],
        [b, c, middle(a, d)],
        [b, d, middle(a, c)],
        [c, d, middle(a, b)],
    ]
}

/// Aspect ratio of a triangle (§ 2.2.2, fig. 2.8): for each node, the rectangles along its median
/// and along the line between the middles of the edges that meet there; longer over shorter side,
/// over √3.
fn triangle_aspect_ratio(triangle: &[Vec3; 3]) -> f64 {
    let mut worst = 0.0f64;
    for n in 0..3 {
        let [p, q, r] = [n, (n + 1) % 3, (n + 2) % 3].map(|m| triangle[m]);
        let median = 0.5 * (q + r) - p;
        let across = 0.5 * (r - q);
        let area = median.cross(&across).norm();
        for side in [median.norm_squared(), across.norm_squared()] {
            worst = worst.max(side / area).max(area / side);
        }
    }
    worst / 3f64.sqrt()
}

fn triangle_max_angle(triangle: &[Vec3; 3]) -> f64 {
    let at = |n: usize| {
        let [p, q, r] = [n, (n + 1) % 3, (n + 2) % 3].map(|m| triangle[m]);
        (q - p).angle(&(r - p))
    };
    at(0).max(at(1)).max(at(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn regular() -> [Vec3; 4] {
        [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
            .map(|p: [f64; 3]| 3.0 * Vec3::from(p))
    }

    #[test]
    fn the_regular_tetrahedron_is_ideal() {
        let [a, b, c, d] = regular();
        let corners = [a, c, b, d];
        let corners = if equivolume(&corners) > 0.0 { corners } else { [a, b, c, d] };
        let shape = shape(&corners);
        assert!(shape.skewness.abs() < 1e-12);
        assert!((shape.scaled_jacobian - 1.0).abs() < 1e-12);
        assert!((triangle_aspect_ratio(&[a, b, c]) - 1.0).abs() < 1e-12);
        assert!((triangle_max_angle(&[a, b, c]).to_degrees() - 60.0).abs() < 1e-9);
        // Cross-sections: isosceles with sides 1, √3/2, √3/2.
        assert!((shape.max_angle_deg - (1f64 / 3.0).acos().to_degrees()).abs() < 1e-9);
    }

    #[test]
    fn the_corner_of_a_cube_has_the_closed_forms() {
        let corners = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        let shape = shape(&corners);
        // V = 1/6, R = √3/2: skewness 1 - (1/6) / (8√3/27 · 3√3/8) = 1/2.
        assert!((shape.skewness - 0.5).abs() < 1e-12);
        // Largest product of edges at a corner: 1 · √2 · √2.
        assert!((shape.scaled_jacobian - 0.5f64.sqrt()).abs() < 1e-12);
        assert!((shape.max_angle_deg - 90.0).abs() < 1e-9);
        // Right isosceles triangle, node at an end of the hypotenuse: median (1, -1/2), across 1/2:
        // sides 5/4 and 1/4, area 1/2: 5/2 over √3.
        let face = [Vec3::zeros(), Vec3::x(), Vec3::y()];
        assert!((triangle_aspect_ratio(&face) - 2.5 / 3f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn flat_is_one_and_inverted_is_more() {
        let at = |height: f64| [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::new(0.3, 0.4, height)];
        assert_eq!(shape(&at(0.0)).skewness, 1.0);
        assert!(shape(&at(-0.3)).skewness > 1.0);
        assert!(shape(&at(-0.3)).scaled_jacobian < 0.0);
        let summary = quality(&at(1e-3), &[[0, 1, 2, 3]]).summary;
        assert_eq!((summary.over_075, summary.over_095), (1, 1));
        assert!(summary.max_angle_deg > 165.0);
    }
}
