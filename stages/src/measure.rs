//! What a breast measures in one pose, side by side: volumes, protrusion, nipple, skin.

use crate::{register::Registered, surface::PoseSurfaces};
use mammotwin_data::{
    Failure, Vec3,
    io::hdf5,
    labels::{LabelMap, Side, Tissue},
    landmarks::Landmarks,
    metric::Metric,
    progress::Progress,
    rigid::RigidTransform,
    store::{Artifact, Stage},
    surface::TriMesh,
    volume::Volume,
};
use mammotwin_imaging::mri::{
    breast::{self, Volumes},
    skin,
};
use mammotwin_solver::distance::SurfaceIndex;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Measures the breasts of one pose.
#[derive(Debug, Clone, Serialize)]
pub struct Measure;

/// What tells where a nipple is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NippleFrom {
    /// The landmark `nipple_right` or `nipple_left`.
    Landmark,
    /// A voxel of the label of nipple and areola: the farthest from the chest wall.
    Label,
    /// What stands out of the smooth skin.
    Bump,
    /// No more than the place that is farthest from the chest wall.
    Farthest,
}

impl NippleFrom {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Landmark => "landmark",
            Self::Label => "label",
            Self::Bump => "bump of the skin",
            Self::Farthest => "farthest from the chest wall",
        }
    }
}

/// Thickness of the skin of a breast (mm).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SkinSpread {
    /// Half of it is thinner.
    pub median_mm: f64,
    /// 5 % of it are thinner.
    pub p05_mm: f64,
    /// 95 % of it are thinner.
    pub p95_mm: f64,
    /// Share of the skin on which it could be told.
    pub seen: f64,
}

/// One breast in one pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SideMeasures {
    /// Which.
    pub side: Side,
    /// Fat, gland, skin and nipple in front of the chest wall, between the breast limits (cm³).
    pub volume_cm3: f64,
    /// Fibroglandular tissue (cm³).
    pub gland_cm3: f64,
    /// Share of gland in gland and fat, by volume: breast density.
    pub gland_share: f64,
    /// Greatest distance of its skin from the chest wall (mm).
    pub protrusion_mm: f64,
    /// The nipple, in the frame of the reference pose (mm).
    pub nipple_mm: Vec3,
    /// What tells so.
    pub nipple_from: NippleFrom,
    /// Thickness of the skin; `None` where the image does not show it.
    pub skin: Option<SkinSpread>,
}

/// The breasts in one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseMeasures {
    /// Right and left.
    pub sides: [SideMeasures; 2],
    /// Skin on which a thickness was told, in the frame of the reference pose ...
    pub skin: TriMesh,
    /// ... and its thickness (mm) at each vertex.
    pub skin_mm: Vec<f64>,
    /// Why there is no thickness; empty when there is one.
    pub no_skin: String,
}

impl Artifact for PoseMeasures {
    const EXTENSION: &'static str = "h5";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut file = hdf5::Writer::create(path)?;
        file.frame(hdf5::Frame::Ras)?;
        file.put_json("sides", &self.sides, "measures of the right and the left breast")?;
        file.put_text("no_skin", &self.no_skin, "why there is no thickness of the skin")?;
        if self.no_skin.is_empty() {
            file.put_surface("skin", &self.skin)?;
            file.put("skin/thickness_mm", &self.skin_mm, "mm", "thickness of the skin")?;
        }
        Ok(file.finish()?)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        let file = hdf5::Reader::open(path)?;
        let no_skin = file.text("no_skin")?;
        let (skin, skin_mm) = match no_skin.is_empty() {
            true => (file.surface("skin")?, file.get("skin/thickness_mm")?),
            false => (TriMesh::default(), Vec::new()),
        };
        Ok(Self { sides: file.json("sides")?, skin, skin_mm, no_skin })
    }
}

impl Stage for Measure {
    const NAME: &'static str = "measure";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Volumes are counted in the labels. Protrusion is the greatest distance of the skin of a \
         breast from the chest wall. Where voxels resolve it, the thickness of the skin was fitted to the \
         brightness along its normals: a layer of one brightness between air and fat, blurred by the voxels.";
    /// Image, labels and surfaces of the pose, its landmarks, and its motion to the reference pose.
    type Input = (Volume<f32>, LabelMap, PoseSurfaces, Option<Landmarks>, Option<Registered>);
    type Output = PoseMeasures;

    fn run(
        &self,
        (scan, labels, surfaces, landmarks, registered): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<PoseMeasures, Failure> {
        let motion = registered.as_ref().map_or(RigidTransform::identity(), |r| r.transform);
        let skin = &surfaces.skin;
        progress.report(0.0, "volumes");
        let sides = breast::sides(labels);
        let wall_mm = wall_distances(surfaces)?;
        let owners = owners(labels, &sides, skin);
        let of = |side: Side| -> Vec<bool> {
            owners.iter().map(|owner| matches!(owner, Some((s, _)) if *s == side)).collect()
        };
        progress.report(0.3, "skin");
        let wanted: Vec<bool> = owners.iter().map(Option::is_some).collect();
        let (thickness, no_skin) = match skin::thickness(scan, skin, &wanted) {
            Ok(map) => (map.thickness_mm, String::new()),
            Err(why) => (Vec::new(), why.to_string()),
        };
        let heights = breast::bumps(skin, &wanted);
        let one = |side: Side| {
            let volumes = Volumes::of(labels, &sides, side);
            let share = volumes.gland_share();
            let own = of(side);
            let farthest = (0..own.len())
                .filter(|&n| own[n])
                .max_by(|&a, &b| wall_mm[a].total_cmp(&wall_mm[b]));
            let (Some(gland_share), Some(farthest)) = (share, farthest) else {
                let why = format!(
                    "labels: no {} breast under the skin; give labels of both breasts",
                    side.name()
                );
                return Err(Failure::BadInput(why));
            };
            let areola = |n: &usize| matches!(owners[*n], Some((_, Tissue::NippleAreola)));
            let labelled = (0..own.len()).filter(|&n| own[n]).filter(areola);
            let labelled = labelled.max_by(|&a, &b| wall_mm[a].total_cmp(&wall_mm[b]));
            let marked = landmarks.as_ref();
            let marked = marked.and_then(|l| l.0.get(&format!("nipple_{}", side.name())));
            let bump = breast::nipple(&heights, &own, &wall_mm);
            let (nipple, nipple_from) = match (marked, labelled, bump) {
                (Some(p), _, _) => (*p, NippleFrom::Landmark),
                (None, Some(n), _) => (skin.points[n], NippleFrom::Label),
                (None, None, Some(n)) => (skin.points[n], NippleFrom::Bump),
                (None, None, None) => (skin.points[farthest], NippleFrom::Farthest),
            };
            Ok(SideMeasures {
                side,
                volume_cm3: volumes.total_mm3() / 1000.0,
                gland_cm3: volumes.gland_mm3 / 1000.0,
                gland_share,
                protrusion_mm: wall_mm[farthest],
                nipple_mm: motion.point(&nipple),
                nipple_from,
                skin: spread(&own, &thickness),
            })
        };
        let sides = [one(Side::Right)?, one(Side::Left)?];
        progress.report(0.9, "map of the skin");
        let (skin, skin_mm) = patch(skin, &thickness, &motion);
        Ok(PoseMeasures { sides, skin, skin_mm, no_skin })
    }
}

/// Distance (mm) of each vertex of the skin from the chest wall.
fn wall_distances(surfaces: &PoseSurfaces) -> Result<Vec<f64>, Failure> {
    let closest = SurfaceIndex::new(&surfaces.chest_wall)
        .and_then(|index| index.closest_of(&surfaces.skin.points))
        .map_err(|cause| Failure::BadInput(format!("chest wall: {cause}")))?;
    Ok(closest.iter().map(|closest| closest.distance_mm).collect())
}

/// The breast that each vertex of the skin covers, and the tissue right under it: of the first voxel of
/// the body inwards. `None` beside the breasts.
fn owners(
    labels: &LabelMap,
    sides: &[Option<Side>],
    skin: &TriMesh,
) -> Vec<Option<(Side, Tissue)>> {
    let grid = &labels.grid;
    let to_voxel = grid.to_voxel();
    let step_mm = 0.5 * grid.spacing_mm().into_iter().fold(0.0, f64::max);
    let normals = skin.vertex_normals();
    let owner = |n: usize| {
        for step in 1..=4 {
            let p = skin.points[n] - f64::from(step) * step_mm * normals[n];
            let voxel = to_voxel.apply(&p).map(f64::round);
            if (0..3).any(|axis| !(voxel[axis] >= 0.0 && voxel[axis] < grid.shape[axis] as f64)) {
                return None;
            }
            let at = grid.index([0, 1, 2].map(|axis| voxel[axis] as usize));
            if labels.values[at] != Tissue::Background {
                return sides[at].map(|side| (side, labels.values[at]));
            }
        }
        None
    };
    (0..skin.points.len()).map(owner).collect()
}

/// Thickness over the vertices of one breast; `None` where it was told on less than a tenth of them.
fn spread(own: &[bool], thickness: &[Option<f64>]) -> Option<SkinSpread> {
    let of_breast = own.iter().filter(|own| **own).count();
    let told = thickness.iter().zip(own).filter(|(_, own)| **own);
    let mut told: Vec<f64> = told.filter_map(|(mm, _)| *mm).collect();
    let seen = told.len() as f64 / of_breast.max(1) as f64;
    if seen < 0.1 {
        return None;
    }
    told.sort_by(f64::total_cmp);
    let at = |share: f64| told[(share * (told.len() - 1) as f64).round() as usize];
    Some(SkinSpread { median_mm: at(0.5), p05_mm: at(0.05), p95_mm: at(0.95), seen })
}

/// The part of the skin whose thickness is known, moved, with the thickness.
fn patch(
    skin: &TriMesh,
    thickness: &[Option<f64>],
    motion: &RigidTransform,
) -> (TriMesh, Vec<f64>) {
    if thickness.is_empty() {
        return (TriMesh::default(), Vec::new());
    }
    let known = |corners: &&[u32; 3]| corners.iter().all(|&n| thickness[n as usize].is_some());
    let triangles = skin.triangles.iter().filter(known).copied().collect();
    let points = skin.points.iter().map(|p| motion.point(p)).collect();
    let (patch, old) = TriMesh { points, triangles }.compacted();
    let values = old.iter().filter_map(|&n| thickness[n as usize]).collect();
    (patch, values)
}

impl PoseMeasures {
    /// The numbers of a pose, named `POSE_SIDE_what_unit`.
    pub fn metrics(&self, pose: &str) -> Vec<Metric> {
        let mut metrics = Vec::new();
        for one in &self.sides {
            let side = one.side.name();
            let mut add = |what: &str, long: &str, unit: &str, value: f64, source: &str| {
                let (name, long) =
                    (format!("{pose}_{side}_{what}"), format!("{pose}, {side} breast: {long}"));
                metrics.push(Metric::new(&name, &long, unit, value, source));
            };
            let counted = "voxels of the labels";
            add("breast_volume_cm3", "volume", "cm3", one.volume_cm3, counted);
            add("gland_volume_cm3", "volume of gland", "cm3", one.gland_cm3, counted);
            let long = "share of gland in gland and fat, by volume";
            add("gland_share", long, "", one.gland_share, counted);
            let long = "greatest distance of its skin from the chest wall";
            add("protrusion_mm", long, "mm", one.protrusion_mm, "surfaces of the labels");
            for (axis, value) in ["x", "y", "z"].iter().zip(one.nipple_mm.iter()) {
                let long = format!("nipple, {axis} in the frame of the reference pose");
                let what = format!("nipple_{axis}_mm");
                add(&what, &long, "mm", *value, one.nipple_from.name());
            }
            let Some(skin) = one.skin else { continue };
            let fitted = "profiles of the image";
            let long = "thickness of the skin, median";
            add("skin_median_mm", long, "mm", skin.median_mm, fitted);
            let long = "thickness of the skin, 5 % are thinner";
            add("skin_p05_mm", long, "mm", skin.p05_mm, fitted);
            let long = "thickness of the skin, 95 % are thinner";
            add("skin_p95_mm", long, "mm", skin.p95_mm, fitted);
        }
        metrics
    }
}
