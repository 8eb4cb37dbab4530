//! Markers on the breasts, carried by the simulated skin: what distances of surfaces cannot tell.
//!
//! A skin may lie on another one although its tissue slid along it. A marker that sticks to the skin
//! and is seen in two poses tells how far: it is carried by the skin of the model from the reference
//! pose to the other one and compared with the place where it was measured there.

use crate::{
    artifact::{load_json, save_json},
    calibrate::Calibration,
    mesh::BreastMesh,
    register::Registered,
    validate::Validation,
};
use mammotwin_data::{
    Failure, Mat3, Vec3,
    landmarks::Landmarks,
    mesh::Patch,
    progress::Progress,
    store::{Artifact, Stage},
    surface::{TriMesh, barycentric},
};
use mammotwin_solver::distance::{DistanceError, SurfaceIndex};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Landmarks whose names start so stick to a breast. Those of the chest wall serve the registration.
const ON_BREAST: [&str; 2] = ["breast_", "nipple_"];
/// A marker farther than this (mm) from the model's skin in the reference pose does not stick to it: it lies beside the
/// model, or in another image. The thickest capsules stand 5 mm off.
const OFF_SKIN_MM: f64 = 10.0;

/// Markers of one pose beside those that the simulated skin carries there.
#[derive(Debug, Clone, Serialize)]
pub struct Carry {
    /// Name of the pose.
    pub pose: String,
}

/// A carried marker against the measured one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Miss {
    /// Where the simulated skin carries the marker (mm, frame of the reference pose).
    pub carried: Vec3,
    /// Carried less measured place along the outward normal of the simulated skin (mm).
    pub normal_mm: f64,
    /// Length of what is left of it, along the skin (mm).
    pub tangential_mm: f64,
}

impl Miss {
    /// Distance (mm) of the carried from the measured marker.
    pub fn distance_mm(&self) -> f64 {
        self.normal_mm.hypot(self.tangential_mm)
    }
}

/// One marker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fiducial {
    /// Its name in both tables of landmarks.
    pub name: String,
    /// Where it was measured in the reference pose (mm).
    pub reference: Vec3,
    /// Where it was measured in this pose (mm, frame of the reference pose).
    pub measured: Vec3,
    /// With the moduli of the study.
    pub before: Miss,
    /// With the fitted moduli.
    pub after: Miss,
}

impl Fiducial {
    /// How far (mm) it moved: the error of no model at all.
    pub fn moved_mm(&self) -> f64 {
        (self.measured - self.reference).norm()
    }
}

/// The markers of one pose.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Fiducials {
    /// Name of the pose.
    pub pose: String,
    /// Markers that both poses have, by name.
    pub markers: Vec<Fiducial>,
    /// Names of those that are not on the model's skin in the reference pose.
    pub off_skin: Vec<String>,
}

/// Means and maxima over the markers of a pose (mm).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Mean distance.
    pub mean_mm: f64,
    /// Largest distance.
    pub max_mm: f64,
    /// Mean part along the skin.
    pub tangential_mean_mm: f64,
    /// Largest part along the skin.
    pub tangential_max_mm: f64,
    /// Mean length of the part along the normal.
    pub normal_mean_mm: f64,
}

impl Summary {
    /// Of some misses; `None` of none.
    pub fn of(misses: &[Miss]) -> Option<Self> {
        let mean =
            |of: &dyn Fn(&Miss) -> f64| misses.iter().map(of).sum::<f64>() / misses.len() as f64;
        let max = |of: &dyn Fn(&Miss) -> f64| misses.iter().map(of).fold(0.0, f64::max);
        (!misses.is_empty()).then(|| Self {
            mean_mm: mean(&Miss::distance_mm),
            max_mm: max(&Miss::distance_mm),
            tangential_mean_mm: mean(&|miss| miss.tangential_mm),
            tangential_max_mm: max(&|miss| miss.tangential_mm),
            normal_mean_mm: mean(&|miss| miss.normal_mm.abs()),
        })
    }
}

impl Fiducials {
    /// With the moduli of the study; `None` without markers.
    pub fn before(&self) -> Option<Summary> {
        Summary::of(&self.markers.iter().map(|marker| marker.before).collect::<Vec<_>>())
    }

    /// With the fitted moduli.
    pub fn after(&self) -> Option<Summary> {
        Summary::of(&self.markers.iter().map(|marker| marker.after).collect::<Vec<_>>())
    }

    /// Mean way (mm) of the markers from the reference pose.
    pub fn moved_mm(&self) -> Option<f64> {
        let sum: f64 = self.markers.iter().map(Fiducial::moved_mm).sum();
        (!self.markers.is_empty()).then(|| sum / self.markers.len() as f64)
    }
}

/// Whether the name of a landmark says that it sticks to a breast.
pub fn on_breast(name: &str) -> bool {
    ON_BREAST.iter().any(|prefix| name.starts_with(prefix))
}

/// Markers of both poses (mm, each in its own image) whose names say that they stick to a breast.
pub fn pairs(reference: &Landmarks, pose: &Landmarks) -> Vec<(String, Vec3, Vec3)> {
    ON_BREAST.iter().flat_map(|prefix| reference.pairs(pose, prefix)).collect()
}

/// A marker on a face of the skin: weights of the corners, and what it stands off in the frame of the face.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    corners: [u32; 3],
    weights: [f64; 3],
    off: Vec3,
}

/// Markers that stick to a skin, in the order in which they were given; `None` where a marker is off the skin.
#[derive(Debug, Clone)]
pub struct Anchors<'a> {
    faces: &'a [[u32; 3]],
    anchors: Vec<Option<Anchor>>,
}

impl<'a> Anchors<'a> {
    /// Sticks each marker to the nearest face of a skin, whose nodes are at `points`.
    ///
    /// # Errors
    /// A skin without a face or a place that is not finite.
    pub fn new(
        faces: &'a [[u32; 3]],
        points: &[Vec3],
        markers: &[Vec3],
    ) -> Result<Self, DistanceError> {
        let skin = TriMesh { points: points.to_vec(), triangles: faces.to_vec() };
        let found = SurfaceIndex::new(&skin)?.closest_of(markers)?;
        let one = |(found, marker): (&mammotwin_solver::distance::Closest, &Vec3)| {
            let corners = faces[found.triangle];
            let at = corners.map(|n| points[n as usize]);
            let frame = frame(&at)?;
            let off = frame.transpose() * (marker - found.point);
            let weights = barycentric(at, &found.point);
            (found.distance_mm <= OFF_SKIN_MM).then_some(Anchor { corners, weights, off })
        };
        let anchors = found.iter().zip(markers).map(one).collect();
        Ok(Self { faces, anchors })
    }

    /// Carries the markers to where the nodes of the skin are at `points`, and compares them with where they were
    /// `measured` (mm).
    pub fn misses(&self, points: &[Vec3], measured: &[Vec3]) -> Vec<Option<Miss>> {
        let skin = TriMesh { points: points.to_vec(), triangles: self.faces.to_vec() };
        let normals = skin.vertex_normals();
        let one = |(anchor, measured): (&Option<Anchor>, &Vec3)| {
            let Anchor { corners, weights, off } = (*anchor)?;
            let at = corners.map(|n| points[n as usize]);
            let sum = |values: [Vec3; 3]| -> Vec3 {
                values.iter().zip(weights).map(|(v, w)| w * v).sum()
            };
            let carried = sum(at) + frame(&at)? * off;
            let normal = sum(corners.map(|n| normals[n as usize])).try_normalize(0.0)?;
            let miss = carried - measured;
            let normal_mm = miss.dot(&normal);
            let tangential_mm = (miss - normal_mm * normal).norm();
            Some(Miss { carried, normal_mm, tangential_mm })
        };
        self.anchors.iter().zip(measured).map(one).collect()
    }
}

/// Columns: along the first edge, across it, outward; `None` of a face without area.
fn frame([a, b, c]: &[Vec3; 3]) -> Option<Mat3> {
    let along = (b - a).try_normalize(0.0)?;
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
    Some(Mat3::from_columns(&[along, normal.cross(&along), normal]))
}

impl Artifact for Fiducials {
    const EXTENSION: &'static str = "json";

    fn save(&self, path: &Path) -> Result<(), Failure> {
        save_json(self, path)
    }

    fn load(path: &Path) -> Result<Self, Failure> {
        load_json(path)
    }
}

impl Stage for Carry {
    const NAME: &'static str = "fiducials";
    const VERSION: u32 = 1;
    const METHODS: &'static str = "Markers on the breasts, which neither registration nor calibration read, were carried from \
         the reference pose by the simulated skin (barycentric coordinates on the nearest face) and compared with \
         the measured ones, along the skin and along its normal.";
    /// The validation of a held-out pose; landmarks of the reference pose and of this one.
    type Input = (BreastMesh, Calibration, Option<Validation>, Registered, (Landmarks, Landmarks));
    type Output = Fiducials;

    fn run(&self, input: &Self::Input, _: &dyn Progress) -> Result<Fiducials, Failure> {
        let (mesh, calibration, validation, registered, (reference, own)) = input;
        let of = |fit: &crate::calibrate::Fit| {
            fit.poses
                .iter()
                .find(|pose| pose.pose == self.pose)
                .map(|pose| pose.solution.points.clone())
        };
        let held_out =
            validation.as_ref().map(|v| (&v.before.solution.points, &v.after.solution.points));
        let states = match held_out {
            Some((before, after)) => Some((before.clone(), after.clone())),
            None => of(&calibration.before).zip(of(&calibration.after)),
        };
        let Some((before, after)) = states else {
            return Err(Failure::BadInput(format!("{}: no such pose was simulated", self.pose)));
        };
        let pairs = pairs(reference, own);
        let stuck: Vec<Vec3> = pairs.iter().map(|(_, there, _)| *there).collect();
        let measured: Vec<Vec3> =
            pairs.iter().map(|(_, _, here)| registered.transform.point(here)).collect();
        let faces = mesh.mesh.patch(Patch::Skin);
        let anchors = Anchors::new(faces, &mesh.mesh.points, &stuck)
            .map_err(|cause| Failure::BadInput(format!("{}: markers: {cause}", self.pose)))?;
        let misses =
            anchors.misses(&before, &measured).into_iter().zip(anchors.misses(&after, &measured));
        let mut found = Fiducials { pose: self.pose.clone(), ..Fiducials::default() };
        for (n, both) in misses.enumerate() {
            let name = pairs[n].0.clone();
            let (Some(before), Some(after)) = both else {
                found.off_skin.push(name);
                continue;
            };
            let (reference, measured) = (stuck[n], measured[n]);
            found.markers.push(Fiducial { name, reference, measured, before, after });
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// A sheet in the plane z = 0 of 10 x 10 mm, facing along +z.
    fn sheet() -> (Vec<[u32; 3]>, Vec<Vec3>) {
        let points = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
        (vec![[0, 1, 2], [0, 2, 3]], points.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec())
    }

    fn only(anchors: &Anchors, points: &[Vec3], measured: Vec3) -> Miss {
        anchors.misses(points, &[measured])[0].unwrap()
    }

    #[test]
    fn a_marker_moves_as_a_turned_skin_does() {
        let (faces, points) = sheet();
        // Inside of a face, on the edge between both, and beyond the rim: 1.5 mm above the sheet.
        for marker in [[7.0, 2.0], [5.0, 5.0], [11.0, 4.0]] {
            let marker = Vec3::new(marker[0], marker[1], 1.5);
            let anchors = Anchors::new(&faces, &points, &[marker]).unwrap();
            let turn = Rotation3::new(Vec3::new(0.4, -1.1, 0.7));
            let moved = |p: &Vec3| turn * p + Vec3::new(3.0, -2.0, 40.0);
            let turned: Vec<Vec3> = points.iter().map(moved).collect();
            let miss = only(&anchors, &turned, moved(&marker));
            assert!(miss.distance_mm() < 1e-12, "{miss:?}");
        }
    }

    #[test]
    fn a_stretched_skin_carries_a_marker_along_and_the_miss_is_split() {
        let (faces, points) = sheet();
        let marker = Vec3::new(4.0, 6.0, 2.0);
        let anchors = Anchors::new(&faces, &points, &[marker]).unwrap();
        // Stretched by 1.6 along x and by 0.8 along y: the skin's own length knows nothing of what stands off it.
        let stretched: Vec<Vec3> =
            points.iter().map(|p| Vec3::new(1.6 * p.x, 0.8 * p.y, p.z)).collect();
        let carried = Vec3::new(6.4, 4.8, 2.0);
        let miss = only(&anchors, &stretched, carried - Vec3::new(3.0, 4.0, -1.0));
        assert!((miss.carried - carried).norm() < 1e-12);
        assert!((miss.tangential_mm - 5.0).abs() < 1e-12, "{miss:?}");
        assert!((miss.normal_mm + 1.0).abs() < 1e-12, "behind the measured marker: {miss:?}");
        assert!((miss.distance_mm() - 26f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_marker_far_from_the_skin_is_not_carried() {
        let (faces, points) = sheet();
        let markers = [Vec3::new(4.0, 6.0, 9.9), Vec3::new(4.0, 6.0, 10.1)];
        let anchors = Anchors::new(&faces, &points, &markers).unwrap();
        let misses = anchors.misses(&points, &markers);
        assert!(misses[0].is_some() && misses[1].is_none(), "{misses:?}");
    }

    #[test]
    fn only_markers_of_the_breasts_in_both_poses_take_part() {
        let of = |names: &[&str]| {
            Landmarks(names.iter().map(|name| (name.to_string(), Vec3::zeros())).collect())
        };
        let here =
            of(&["breast_left_outer", "chest_sternum_inferior", "nipple_left", "nipple_right"]);
        let there = of(&["breast_left_outer", "chest_sternum_inferior", "nipple_left"]);
        let names: Vec<String> = pairs(&here, &there).into_iter().map(|(name, ..)| name).collect();
        assert_eq!(names, ["breast_left_outer", "nipple_left"]);
        assert_eq!(Fiducials::default().after(), None);
        assert_eq!(Fiducials::default().moved_mm(), None);
    }

    #[test]
    fn means_and_maxima_are_over_all_markers() {
        let miss = |normal_mm: f64, tangential_mm: f64| Miss {
            carried: Vec3::zeros(),
            normal_mm,
            tangential_mm,
        };
        let summary = Summary::of(&[miss(-3.0, 4.0), miss(1.0, 0.0)]).unwrap();
        let known = Summary {
            mean_mm: 3.0,
            max_mm: 5.0,
            tangential_mean_mm: 2.0,
            tangential_max_mm: 4.0,
            normal_mean_mm: 2.0,
        };
        assert_eq!(summary, known);
    }
}
