//! Labels of the reference pose to tetrahedra on a smooth chest wall.

use crate::model::{Anatomy, Muscle, Quadratic};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::{LabelMap, Side, Tissue},
    mesh::{Patch, TetMesh},
    progress::Progress,
    store::{Artifact, Stage},
    study::{Elements, MeshPlan},
    volume::{Grid, Volume},
};
use mammotwin_imaging::mri::distance_field::{FieldPlan, distance_field};
use mammotwin_solver::{
    mesh::{
        domain::{Domain, PatchDistances, difference_gradient},
        lattice::Placement,
        quality::{Quality, quality},
        tetrahedralize::{Meshing, tetrahedralize},
    },
    terms::{GridDistance, Target},
};
use rayon::prelude::*;
use serde::Serialize;
use std::{borrow::Cow, path::Path};

/// Spacing (mm) of the chest wall's distance field: smooth, since contact needs its curvature.
pub(crate) const WALL_SPACING_MM: f64 = 3.0;
/// Spacing (mm) of the skin's distance field.
const SKIN_SPACING_MM: f64 = 2.0;
/// Skin and fat in front of the chest wall are at least so many edges thick: thinner ones would
/// fall apart. Thicker ones would let the breast sag farther.
const THINNEST_COVER: f64 = 0.4;
/// Layers with fewer breast voxels than this share of the median layer do not count as breast: beside
/// the breasts a layer holds nothing but the fat under the skin.
const THIN_LAYER: f64 = 0.25;

/// Meshes the breasts of one pose: what lies between skin, chest wall and the breast limits.
#[derive(Debug, Clone, Serialize)]
pub struct Mesh(pub MeshPlan);

/// The breasts of the reference pose, ready for mechanics.
#[derive(Debug, Clone)]
pub struct BreastMesh {
    /// Both breasts with the fat between and beside them; the parts of their elements where these are
    /// quadratic.
    pub mesh: TetMesh,
    /// The elements, where these are quadratic.
    pub quadratic: Option<Quadratic>,
    /// Signed distance (mm) to the chest wall, positive in front of it.
    pub wall: Volume<f32>,
    /// Where the breasts are.
    pub anatomy: Anatomy,
    /// The pectoral muscle, where it is deformable: its nodes are the last of `mesh`, whose tetrahedra and
    /// patches are those of the breasts alone.
    pub muscle: Option<Muscle>,
    /// Shape of the elements.
    pub quality: Quality,
}

impl BreastMesh {
    /// The tetrahedra of four nodes: elements or, where these are quadratic, the straight ones between
    /// their corners, which have the first numbers among the nodes.
    pub fn corners(&self) -> Cow<'_, TetMesh> {
        self.quadratic
            .as_ref()
            .map_or(Cow::Borrowed(&self.mesh), |quadratic| Cow::Owned(quadratic.corners()))
    }

    /// The node of each breast that is its nipple, right first: the skin farthest from the chest wall.
    pub fn nipple_nodes(&self) -> Vec<u32> {
        let nodes = self.mesh.patch_nodes(Patch::Skin);
        let from = |n: &u32, nipple: &Vec3| (self.mesh.points[*n as usize] - nipple).norm();
        let nearest = |nipple: &Vec3| {
            nodes.iter().copied().min_by(|a, b| from(a, nipple).total_cmp(&from(b, nipple)))
        };
        self.anatomy.breasts.iter().filter_map(|breast| nearest(&breast.nipple)).collect()
    }
}

impl Artifact for BreastMesh {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Ras)?;
        file.put_mesh("mesh", &self.mesh)?;
        let quadratic = u8::from(self.quadratic.is_some());
        file.put_scalar("quadratic", quadratic, "1", "whether eight tetrahedra are one element")?;
        file.put_volume("wall", &self.wall, "mm", "signed distance in front of the chest wall")?;
        file.put_json("anatomy", &self.anatomy, "bases of the breasts on the chest wall")?;
        file.put_json("quality", &self.quality, "shape measures of the tetrahedra")?;
        if let Some(muscle) = &self.muscle {
            file.put_json("muscle", muscle, "tetrahedra behind the breasts, on the last nodes")?;
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let mesh = file.mesh("mesh")?;
        let quadratic: u8 = file.scalar("quadratic")?;
        Ok(Self {
            quadratic: (quadratic == 1).then(|| Quadratic::of_parts(&mesh)),
            mesh,
            wall: file.volume("wall")?,
            anatomy: file.json("anatomy")?,
            muscle: if file.has("muscle") { Some(file.json("muscle")?) } else { None },
            quality: file.json("quality")?,
        })
    }
}

/// The planes between the breasts and other tissue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Limits {
    /// z (mm) of the cut below the clavicles.
    pub superior_mm: f64,
    /// z (mm) of the cut at the costal margin.
    pub inferior_mm: f64,
    /// y (mm) of the midaxillary plane.
    pub lateral_mm: f64,
    /// x (mm) of the sternal line.
    pub sternum_mm: f64,
}

impl Limits {
    /// Reads the limits from where the labels of the breasts end.
    pub fn of(labels: &LabelMap) -> Result<Self, Failure> {
        use Tissue::*;
        let mut along_z: Vec<f64> = Vec::new();
        let mut along_y: Vec<f64> = Vec::new();
        let mut right: Vec<f64> = Vec::new();
        let mut left: Vec<f64> = Vec::new();
        for (index, tissue) in labels.values.iter().enumerate() {
            let side = match tissue {
                AdiposeRight | FibroglandularRight => &mut right,
                AdiposeLeft | FibroglandularLeft => &mut left,
                _ => continue,
            };
            let p = labels.grid.center(labels.grid.voxel(index));
            side.push(p.x);
            along_y.push(p.y);
            along_z.push(p.z);
        }
        for (side, found) in [(Side::Right, &right), (Side::Left, &left)] {
            if found.is_empty() {
                return Err(Failure::BadInput(format!(
                    "labels: no voxel of the {} breast; correct the label map",
                    side.name()
                )));
            }
        }
        let grid = &labels.grid;
        let step = |world: usize| grid.spacing_mm()[grid.axis_along(world)];
        let (inferior, superior) = occupied(&along_z, step(2));
        let (lateral, _) = occupied(&along_y, step(1));
        Ok(Self {
            superior_mm: superior,
            inferior_mm: inferior,
            lateral_mm: lateral,
            sternum_mm: 0.5 * (quantile(right, 0.01) + quantile(left, 0.99)),
        })
    }
}

/// Lower end of the first and upper end of the last layer of voxels that holds a fair number of centres, given the
/// centres along an axis and the thickness of a layer (mm).
fn occupied(centers: &[f64], step: f64) -> (f64, f64) {
    let low = centers.iter().copied().fold(f64::INFINITY, f64::min);
    let high = centers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // Each layer has its centres in its middle: rounding does not move one to the next.
    let layer = |center: f64| ((center - low) / step).round() as usize;
    let mut counts = vec![0usize; layer(high) + 1];
    for center in centers {
        counts[layer(*center)] += 1;
    }
    let mut filled: Vec<usize> = counts.iter().copied().filter(|&n| n > 0).collect();
    filled.sort_unstable();
    let enough = THIN_LAYER * filled.get(filled.len() / 2).copied().unwrap_or(0) as f64;
    let first = counts.iter().position(|&n| n as f64 >= enough).unwrap_or(0);
    let last = counts.iter().rposition(|&n| n as f64 >= enough).unwrap_or(0);
    (low + (first as f64 - 0.5) * step, low + (last as f64 + 0.5) * step)
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

/// Skin, chest wall and the planes of the breast limits.
struct BreastDomain {
    skin: GridDistance,
    wall: GridDistance,
    limits: Limits,
    bounds: (Vec3, Vec3),
}

impl BreastDomain {
    /// Distances to the planes of the breast limits.
    fn planes(&self, p: &Vec3) -> PatchDistances {
        let lateral = self.limits.lateral_mm - p.y;
        let right = p.x > self.limits.sternum_mm;
        let [near, far] = if right {
            [Patch::LateralRight, Patch::LateralLeft]
        } else {
            [Patch::LateralLeft, Patch::LateralRight]
        };
        PatchDistances::none()
            .with(Patch::Superior, p.z - self.limits.superior_mm)
            .with(Patch::Inferior, self.limits.inferior_mm - p.z)
            .with(near, lateral)
            // Both sides share one plane: the other side's half of it is out of reach.
            .with(far, lateral - (p.x - self.limits.sternum_mm).abs())
    }
}

impl Domain for BreastDomain {
    fn distances(&self, p: &Vec3) -> PatchDistances {
        self.planes(p)
            .with(Patch::Skin, self.distance(p, Patch::Skin))
            .with(Patch::ChestWall, self.distance(p, Patch::ChestWall))
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        self.bounds
    }

    fn distance(&self, p: &Vec3, patch: Patch) -> f64 {
        match patch {
            Patch::Skin => self.skin.distance(p).0,
            Patch::ChestWall => -self.wall.distance(p).0,
            _ => self.planes(p).of(patch),
        }
    }

    fn gradient(&self, p: &Vec3, patch: Patch) -> Vec3 {
        match patch {
            Patch::Skin => self.skin.distance(p).1,
            Patch::ChestWall => -self.wall.distance(p).1,
            _ => difference_gradient(self, p, patch),
        }
    }
}

/// Moves a chest wall that is less than `cover` (mm) under the skin down to it, with a soft bend.
fn sink(wall: &mut Volume<f32>, skin: &GridDistance, cover: f64) {
    let grid = wall.grid.clone();
    wall.values.par_iter_mut().enumerate().for_each(|(n, wall)| {
        let above_cover = skin.distance(&grid.center(grid.voxel(n))).0 + cover;
        *wall = soft_max(f64::from(*wall), above_cover, WALL_SPACING_MM) as f32;
    });
}

/// The larger of two values, once differentiable: rounded where they differ by less than `width`.
pub(crate) fn soft_max(a: f64, b: f64, width: f64) -> f64 {
    let near = (width - (a - b).abs()).max(0.0);
    a.max(b) + 0.25 * near * near / width
}

/// Corners of the box of a grid.
fn corners(grid: &Grid) -> (Vec3, Vec3) {
    let [i, j, k] = grid.shape.map(|n| n.saturating_sub(1) as f64);
    let (a, b) = (grid.origin, grid.world(&Vec3::new(i, j, k)));
    (a.inf(&b), a.sup(&b))
}

impl Stage for Mesh {
    const NAME: &'static str = "mesh";
    const VERSION: u32 = 6;
    const METHODS: &'static str = "The tissue between skin, pectoral muscle and the breast limits was filled with \
         tetrahedra by clipping a body-centred lattice on smooth signed distance fields \
         (after Labelle and Shewchuk, ACM Trans. Graph. 26 (2007) 57).";
    type Input = LabelMap;
    type Output = BreastMesh;

    fn run(&self, labels: &LabelMap, progress: &dyn Progress) -> Result<BreastMesh, Failure> {
        self.lying(labels, Meshing::of_size(self.0.size_mm).placement, progress)
    }
}

impl Mesh {
    /// The same mesh on a lattice that lies otherwise.
    ///
    /// # Errors
    /// As the stage.
    pub fn lying(
        &self,
        labels: &LabelMap,
        placement: Placement,
        progress: &dyn Progress,
    ) -> Result<BreastMesh, Failure> {
        let MeshPlan { size_mm, elements } = self.0;
        let limits = Limits::of(labels)?;
        let field = |mask: Volume<bool>, spacing_mm: f64| {
            distance_field(&mask, &FieldPlan::of_spacing(spacing_mm))
                .map_err(|cause| Failure::BadInput(format!("labels: {cause}")))
        };
        progress.report(0.05, "distance field of the skin");
        let skin = field(labels.map(|t| t != Tissue::Background), SKIN_SPACING_MM)?;
        progress.report(0.3, "distance field of the chest wall");
        let mut wall = field(labels.map(Tissue::is_chest_wall), WALL_SPACING_MM)?;
        let spline = GridDistance::new(&skin);
        sink(&mut wall, &spline, THINNEST_COVER * size_mm);
        let (mut low, mut high) = corners(&skin.grid);
        (low.y, low.z) = (limits.lateral_mm, limits.inferior_mm);
        high.z = limits.superior_mm;
        let domain = BreastDomain {
            skin: spline,
            wall: GridDistance::new(&wall),
            limits,
            bounds: (low, high),
        };
        let tissue = |p: &Vec3| {
            if p.x > limits.sternum_mm { Tissue::AdiposeRight } else { Tissue::AdiposeLeft }
        };
        progress.report(0.5, "tetrahedra");
        let meshing = Meshing { size_mm, placement };
        let mesh = tetrahedralize(&domain, &meshing, tissue)
            .map_err(|cause| Failure::Numerics(format!("mesh: {cause}")))?;
        let anatomy = Anatomy::of(&mesh, limits.sternum_mm)
            .map_err(|cause| Failure::BadInput(format!("labels: {cause}")))?;
        let quality = quality(&mesh.points, &mesh.tets);
        let (mesh, quadratic) = match elements {
            Elements::Linear => (mesh, None),
            Elements::Quadratic => {
                let (quadratic, parts) = Quadratic::fitted(mesh, &domain);
                (parts, Some(quadratic))
            }
        };
        Ok(BreastMesh { mesh, quadratic, wall, anatomy, muscle: None, quality })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_data::Mat3;

    /// Skin at z = 0, the wall 1 mm under it on the left and 30 mm on the right.
    #[test]
    fn a_wall_close_under_the_skin_sinks_and_a_deep_one_stays() {
        let grid = Grid::aligned([41, 3, 31], [3.0; 3], Vec3::new(-60.0, -3.0, -60.0));
        let of = |value: &dyn Fn(Vec3) -> f64| Volume {
            values: (0..grid.len()).map(|n| value(grid.center(grid.voxel(n))) as f32).collect(),
            grid: grid.clone(),
        };
        let skin = GridDistance::new(&of(&|p| p.z));
        let mut wall = of(&|p| p.z + if p.x < 0.0 { 1.0 } else { 30.0 });
        let before = wall.clone();
        sink(&mut wall, &skin, 6.0);
        for n in 0..grid.len() {
            let p = grid.center(grid.voxel(n));
            if p.x < 0.0 {
                assert!((f64::from(wall.values[n]) - (p.z + 6.0)).abs() < 1e-3, "{p}");
            } else {
                assert_eq!(wall.values[n], before.values[n]);
            }
        }
    }

    /// Breasts that end between voxels of 1 x 2 x 3.3 mm, whichever way these are stored.
    #[test]
    fn limits_lie_between_voxels_in_any_order_of_storage() {
        let origin = Vec3::new(-19.5, -7.0, 11.0);
        let ras = Grid::aligned([40, 30, 20], [1.0, 2.0, 3.3], origin);
        let columns = [0, 1, 2].map(|axis| ras.axes.column(axis).into_owned());
        let pir = Grid {
            shape: [30, 20, 40],
            axes: Mat3::from_columns(&[-columns[1], -columns[2], columns[0]]),
            origin: ras.center([0, 29, 19]),
        };
        let [lateral, inferior, superior] =
            [origin.y + 7.5 * 2.0, origin.z + 3.5 * 3.3, origin.z + 15.5 * 3.3];
        for grid in [ras, pir] {
            let tissue = |n| {
                let p = grid.center(grid.voxel(n));
                match (p.y > lateral && p.z > inferior && p.z < superior, p.x > 0.0) {
                    (false, _) => Tissue::Other,
                    (true, true) => Tissue::AdiposeRight,
                    (true, false) => Tissue::AdiposeLeft,
                }
            };
            let labels = Volume { values: (0..grid.len()).map(tissue).collect(), grid };
            let found = Limits::of(&labels).unwrap();
            println!("{found:?}; true {lateral} {inferior} {superior}");
            for (found, known) in [
                (found.lateral_mm, lateral),
                (found.inferior_mm, inferior),
                (found.superior_mm, superior),
                (found.sternum_mm, 0.0),
            ] {
                assert!((found - known).abs() < 1e-9, "{found} for {known}");
            }
        }
    }

    #[test]
    fn the_soft_maximum_has_no_kink() {
        assert_eq!((soft_max(1.0, 9.0, 3.0), soft_max(9.0, 1.0, 3.0)), (9.0, 9.0));
        let slope = |a: f64| (soft_max(a + 1e-6, 0.0, 3.0) - soft_max(a - 1e-6, 0.0, 3.0)) / 2e-6;
        for a in [-3.0, 0.0, 3.0] {
            assert!((slope(a + 1e-4) - slope(a - 1e-4)).abs() < 1e-3, "{a}");
        }
    }
}
