//! Where the breasts are on the chest wall: found from the shape of the mesh alone.

use mammotwin_data::{
    Vec3,
    labels::Side,
    mesh::{Patch, TetMesh},
};
use mammotwin_solver::distance::SurfaceIndex;
use serde::{Deserialize, Serialize};

/// The base of one breast, as an ellipse on the chest wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BreastBase {
    /// Which breast.
    pub side: Side,
    /// Centre of the base on the chest wall (mm).
    pub center: Vec3,
    /// Unit tangent of the wall across the body, away from the sternum.
    pub lateral: Vec3,
    /// Unit tangent of the wall along the body, towards the head.
    pub cranial: Vec3,
    /// Unit normal of the wall, away from the body.
    pub normal: Vec3,
    /// Half axes of the base along `lateral` and `cranial` (mm).
    pub half_axes_mm: [f64; 2],
    /// The skin point farthest from the chest wall (mm).
    pub nipple: Vec3,
    /// Its distance from the wall (mm).
    pub projection_mm: f64,
}

impl BreastBase {
    /// Elliptic coordinates of a point: (lateral, cranial) over the half axes.
    pub fn elliptic(&self, p: &Vec3) -> [f64; 2] {
        let d = p - self.center;
        [d.dot(&self.lateral) / self.half_axes_mm[0], d.dot(&self.cranial) / self.half_axes_mm[1]]
    }

    /// The inframammary fold: the lower end of the base (mm).
    pub fn fold(&self) -> Vec3 {
        self.center - self.half_axes_mm[1] * self.cranial
    }

    /// Elliptic radius of a point: 1 on the rim of the base.
    pub fn radius(&self, p: &Vec3) -> f64 {
        let [a, b] = self.elliptic(p);
        a.hypot(b)
    }
}

/// Where the breasts are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Anatomy {
    /// x of the sternal line (mm).
    pub sternum_x_mm: f64,
    /// The breasts that the mesh holds, right first.
    pub breasts: Vec<BreastBase>,
}

/// Why no breast was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("no {} breast stands out from the chest wall; check the labels", side.name())]
pub struct NoBreast {
    /// The side without a breast.
    pub side: Side,
}

impl Anatomy {
    /// Finds the breasts of `mesh` on both sides of the sternal line.
    ///
    /// Each breast is taken for a half ellipsoid over the fat layer: weighted by its thickness,
    /// the variance of the wall coordinates is a fifth of the squared half axis.
    pub fn of(mesh: &TetMesh, sternum_x_mm: f64) -> Result<Self, NoBreast> {
        let wall = mesh.patch_surface(Patch::ChestWall);
        let normals: Vec<Vec3> = wall.vertex_normals().iter().map(|n| -n).collect();
        let skin = SurfaceIndex::new(&mesh.patch_surface(Patch::Skin))
            .map_err(|_| NoBreast { side: Side::Right })?;
        let mut area = vec![0.0; mesh.points.len()];
        for t in 0..wall.triangles.len() {
            let third = wall.area_vector(t).norm() / 3.0;
            for n in wall.triangles[t] {
                area[n as usize] += third;
            }
        }
        let nodes = mesh.patch_nodes(Patch::ChestWall);
        let from_skin = |&n: &u32| skin.closest(&mesh.points[n as usize]);
        let thickness: Vec<f64> =
            nodes.iter().map(|n| from_skin(n).map_or(0.0, |c| c.distance_mm)).collect();
        let mut sorted = thickness.clone();
        sorted.sort_by(f64::total_cmp);
        let layer = sorted.get(sorted.len() / 4).copied().unwrap_or(0.0);

        let base = |side: Side| -> Result<BreastBase, NoBreast> {
            let none = NoBreast { side };
            let mut sum = 0.0;
            let (mut center, mut normal) = (Vec3::zeros(), Vec3::zeros());
            let mut weights = Vec::new();
            for (&n, &h) in nodes.iter().zip(&thickness) {
                let p = mesh.points[n as usize];
                let here = (p.x - sternum_x_mm) * side.sign() > 0.0;
                let weight = if here { area[n as usize] * (h - layer).max(0.0) } else { 0.0 };
                sum += weight;
                center += weight * p;
                normal += weight * normals[n as usize];
                weights.push(weight);
            }
            if sum <= 0.0 {
                return Err(none);
            }
            center /= sum;
            let normal = normal.try_normalize(0.0).ok_or(none.clone())?;
            let up = Vec3::z() - normal * normal.z;
            let cranial = up.try_normalize(1e-6).ok_or(none.clone())?;
            let lateral = side.sign() * normal.cross(&cranial);
            let mut variance = [0.0; 2];
            for (&n, &weight) in nodes.iter().zip(&weights) {
                let d = mesh.points[n as usize] - center;
                variance[0] += weight / sum * d.dot(&lateral).powi(2);
                variance[1] += weight / sum * d.dot(&cranial).powi(2);
            }
            let half_axes_mm = variance.map(|v| (5.0 * v).sqrt());
            // The wall is curved: the weighted mean lies behind it.
            let behind = nodes
                .iter()
                .map(|&n| mesh.points[n as usize])
                .min_by(|a, b| {
                    let off = |p: &Vec3| (p - center - normal * (p - center).dot(&normal)).norm();
                    off(a).total_cmp(&off(b))
                })
                .ok_or(none.clone())?;
            let center = center + normal * (behind - center).dot(&normal);
            let mut base = BreastBase {
                side,
                center,
                lateral,
                cranial,
                normal,
                half_axes_mm,
                nipple: center,
                projection_mm: 0.0,
            };
            for n in mesh.patch_nodes(Patch::Skin) {
                let p = mesh.points[n as usize];
                let height = (p - center).dot(&normal);
                if base.radius(&p) < 1.0 && height > base.projection_mm {
                    (base.nipple, base.projection_mm) = (p, height);
                }
            }
            Ok(base)
        };
        Ok(Self { sternum_x_mm, breasts: vec![base(Side::Right)?, base(Side::Left)?] })
    }

    /// The breast whose base is nearest to `p` in elliptic radius, with that radius.
    pub fn nearest(&self, p: &Vec3) -> Option<(&BreastBase, f64)> {
        self.breasts.iter().map(|b| (b, b.radius(p))).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The breast of a side.
    pub fn breast(&self, side: Side) -> Option<&BreastBase> {
        self.breasts.iter().find(|b| b.side == side)
    }
}
