//! Whether the files of a study can be what the study says they are.

use mammotwin_data::{
    Failure,
    io::{
        landmarks,
        nifti::{self, Summary},
        stl,
        torque::{self, TorqueLaw},
    },
    labels::{LabelMap, Scribbles, Tissue},
    landmarks::Landmarks,
    store::Artifact,
    study::{CompressPlan, Pose, Scan, Study},
    surface::TriMesh,
    volume::{Grid, Volume},
};
use mammotwin_solver::paddles::CadPaddle;
use mammotwin_stages::{compress::from_cad, fiducials, relabel::relabelled};
use std::path::{Path, PathBuf};

/// How much a finding matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// As it should be.
    Good,
    /// Unusual; a run works, its results may be wrong.
    Warning,
    /// A run cannot give sound results.
    Wrong,
}

/// Something that was looked at.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Finding {
    /// Study key: `poses.prone.landmarks`.
    pub key: String,
    /// How much it matters.
    pub weight: Weight,
    /// What was found, and how to mend it.
    pub text: String,
}

/// Distances of neighbouring voxels that a breast image has (mm).
const SPACING_MM: [f64; 2] = [0.1, 10.0];
/// Extents that an image of both breasts has (mm).
const EXTENT_MM: [f64; 2] = [50.0, 1000.0];
/// Extents that a scan of both breasts has (mm): a whole person may be in it.
const SCAN_MM: [f64; 2] = [200.0, 2500.0];
/// Number of chest-wall landmarks that a rigid registration starts from.
const CHEST_LANDMARKS: usize = 3;

/// Edges (mm) above which forces of a compression depend on the elements.
const COARSE_MM: f64 = 10.0;
/// A hinge of which a quadratic law explains less is another one.
const LEAST_R_SQUARED: f64 = 0.95;

/// Looks at every file that a study names. `base` is the folder of the study.
pub fn findings(study: &Study, base: &Path) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut marked = Vec::new();
    for (name, pose) in &study.poses {
        let mut pose = PoseCheck { name, pose, base, found: Vec::new() };
        if let Some(landmarks) = pose.run() {
            marked.push((name, landmarks));
        }
        found.append(&mut pose.found);
    }
    found.extend(study.scans.iter().flat_map(|(name, plan)| scan(name, plan, base)));
    found.extend(common_landmarks(study, &marked));
    found.extend(missing_fiducials(study, &marked));
    if let Some(plan) = &study.compress {
        found.extend(paddle(plan, base));
        found.extend(hinge(plan, base));
        found.extend(coarse(study.mesh.size_mm));
    }
    found
}

/// Whether the files of a scan can be read, and are in the stated units.
fn scan(name: &str, plan: &Scan, base: &Path) -> [Finding; 2] {
    let finding = |key: &str, (weight, text): (Weight, String)| Finding {
        key: format!("scans.{name}.{key}"),
        weight,
        text,
    };
    let wrong = |cause: Failure| (Weight::Wrong, cause.to_string());
    let surface = TriMesh::load(&base.join(&plan.surface)).map_or_else(wrong, |surface| {
        let axis = |n: usize| surface.points.iter().map(move |p| p[n]);
        let extent = |n| axis(n).fold(f64::MIN, f64::max) - axis(n).fold(f64::MAX, f64::min);
        let largest = plan.unit.in_mm() * (0..3).map(extent).fold(0.0, f64::max);
        let text = format!("{} triangles over {largest:.0} mm", surface.triangles.len());
        match (SCAN_MM[0]..=SCAN_MM[1]).contains(&largest) {
            true => (Weight::Good, text),
            false => {
                let [least, most] = SCAN_MM;
                let why = format!(
                    "{text}; a scan of both breasts has {least} to {most} mm: is unit right?"
                );
                (Weight::Wrong, why)
            }
        }
    });
    let marks = landmarks::read(&base.join(&plan.landmarks)).map_err(Failure::from);
    let marks = marks.map_or_else(wrong, |marks| {
        let chest = marks.0.keys().filter(|name| name.starts_with("chest_")).count();
        let text = format!("{chest} landmarks chest_...");
        match chest < CHEST_LANDMARKS {
            true => (Weight::Wrong, format!("{text}; a scan is placed by three or more")),
            false => (Weight::Good, text),
        }
    });
    [finding("surface", surface), finding("landmarks", marks)]
}

/// Whether forces mean anything on such elements (docs/verification.md).
fn coarse(size_mm: f64) -> Option<Finding> {
    let text = format!(
        "a compression on elements of {size_mm} mm: forces on 14 mm are up to twice those on 8 mm; compare \
         forces on equal meshes only, or give 10 mm or less"
    );
    let key = "mesh.size_mm".to_owned();
    (size_mm > COARSE_MM).then_some(Finding { key, weight: Weight::Warning, text })
}

/// How well the torques of a measured hinge follow a quadratic law.
fn hinge(plan: &CompressPlan, base: &Path) -> Option<Finding> {
    let path = base.join(plan.hinge.as_ref()?.file.as_ref()?);
    let law = torque::read(&path).map_err(|why| why.to_string()).and_then(|table| table.law());
    let (weight, text) = match law {
        Err(why) => (Weight::Wrong, why),
        Ok(law) => {
            let TorqueLaw { linear_n_mm_per_rad, quadratic_n_mm_per_rad2, r_squared, .. } = law;
            let text = format!(
                "{} readings to {:.1}°: torque {linear_n_mm_per_rad:.0} θ + {quadratic_n_mm_per_rad2:.0} θ² N mm, \
                 R² = {r_squared:.4}",
                law.readings, law.largest_deg
            );
            (if r_squared < LEAST_R_SQUARED { Weight::Warning } else { Weight::Good }, text)
        }
    };
    Some(Finding { key: "compress.hinge.file".into(), weight, text })
}

/// Whether a paddle from CAD is one.
fn paddle(plan: &CompressPlan, base: &Path) -> Option<Finding> {
    let path = base.join(&plan.cad.as_ref()?.file);
    let key = "compress.cad.file".to_owned();
    let shape = stl::read(&path).and_then(|surface| from_cad(&surface, plan.edge_radius_mm));
    Some(match shape {
        Err(why) => {
            let text = why.to_string();
            let text = text.strip_prefix("compress.cad.file: ").unwrap_or(&text).to_owned();
            Finding { key, weight: Weight::Wrong, text }
        }
        Ok(CadPaddle { outline, .. }) => {
            let [width, depth] = outline.plate.map_or([0.0; 2], |p| p.half.map(|h| 2.0 * h));
            let text = format!("a face of {width:.0} x {depth:.0} mm");
            Finding { key, weight: Weight::Good, text }
        }
    })
}

struct PoseCheck<'a> {
    name: &'a str,
    pose: &'a Pose,
    base: &'a Path,
    found: Vec<Finding>,
}

impl PoseCheck<'_> {
    fn note(&mut self, key: &str, weight: Weight, text: impl Into<String>) {
        let key = format!("poses.{}.{key}", self.name);
        self.found.push(Finding { key, weight, text: text.into() });
    }

    fn refused(&mut self, key: &str, failure: impl Into<Failure>) {
        let text = match failure.into() {
            Failure::Io { path, cause } => {
                format!("{}: {cause}; paths are relative to the study's folder", path.display())
            }
            failure => failure.to_string(),
        };
        self.note(key, Weight::Wrong, text);
    }

    fn path(&self, file: &Path) -> PathBuf {
        self.base.join(file)
    }

    fn run(&mut self) -> Option<Landmarks> {
        if let Some(warning) = &self.pose.warning {
            self.note("warning", Weight::Warning, warning.clone());
        }
        let grid = match nifti::inspect(&self.path(&self.pose.image)) {
            Ok(summary) => Some(self.image(&summary)),
            Err(error) => {
                self.refused("image", error);
                None
            }
        };
        if let Some(file) = &self.pose.labels {
            match self.read_labels(&self.path(file)) {
                Ok(labels) => self.labels(&labels, grid.as_ref()),
                Err(failure) => self.refused("labels", failure),
            }
        }
        if let Some(file) = &self.pose.scribbles {
            match nifti::read_scribbles(&self.path(file)) {
                Ok(scribbles) => self.scribbles(&scribbles, grid.as_ref()),
                Err(error) => self.refused("scribbles", error),
            }
        }
        let file = self.pose.landmarks.as_ref()?;
        match landmarks::read(&self.path(file)) {
            Ok(landmarks) => {
                self.landmarks(&landmarks, grid.as_ref());
                Some(landmarks)
            }
            Err(error) => {
                self.refused("landmarks", error);
                None
            }
        }
    }

    fn image(&mut self, summary: &Summary) -> Grid {
        let Summary { dims, spacing_mm, orientation, range, .. } = summary;
        for warning in &summary.warnings {
            self.note("image", Weight::Warning, warning.clone());
        }
        if range[0] == range[1] {
            self.note("image", Weight::Wrong, format!("every voxel is {}; no picture", range[0]));
        }
        for axis in 0..3 {
            let (step, extent) = (spacing_mm[axis], spacing_mm[axis] * dims[axis] as f64);
            let plausible = (SPACING_MM[0]..=SPACING_MM[1]).contains(&step)
                && (EXTENT_MM[0]..=EXTENT_MM[1]).contains(&extent);
            if !plausible {
                let text = format!(
                    "pixdim[{}]: {} voxels of {step} mm are {extent} mm: no image of a breast; \
                     correct the units of the header",
                    axis + 1,
                    dims[axis]
                );
                self.note("image", Weight::Wrong, text);
            }
        }
        let [i, j, k] = dims;
        let [a, b, c] = spacing_mm;
        let text = format!("{i} x {j} x {k} voxels of {a:.3} x {b:.3} x {c:.3} mm, {orientation}");
        self.note("image", Weight::Good, text);
        grid(summary)
    }

    fn read_labels(&self, path: &Path) -> Result<LabelMap, Failure> {
        match &self.pose.label_map {
            None => Ok(nifti::read_labels(path)?),
            Some(map) => relabelled(&nifti::read_raw_labels(path)?, map)
                .map_err(|why| Failure::BadInput(format!("{}: {why}", path.display()))),
        }
    }

    fn scribbles(&mut self, Scribbles(marked): &Scribbles, grid: Option<&Grid>) {
        if grid.is_some_and(|grid| !same_place(grid, &marked.grid)) {
            let text = "lie on another grid than the image; draw them on the image itself";
            self.note("scribbles", Weight::Wrong, text);
        }
        let count = |tissue: Tissue| marked.values.iter().filter(|m| **m == Some(tissue)).count();
        let there = Tissue::ALL.map(|tissue| (Scribbles::label(Some(tissue)), count(tissue)));
        let told: Vec<String> = there
            .iter()
            .filter(|(_, count)| *count > 0)
            .map(|(label, count)| format!("{count} of {label}"))
            .collect();
        if told.is_empty() {
            self.note(
                "scribbles",
                Weight::Wrong,
                "no voxel is marked; mark some, or remove the key",
            );
        } else {
            let text = format!("marked voxels: {}", told.join(", "));
            self.note("scribbles", Weight::Good, text);
        }
    }

    fn labels(&mut self, labels: &LabelMap, grid: Option<&Grid>) {
        if grid.is_some_and(|grid| !same_place(grid, &labels.grid)) {
            let text = "lie on another grid than the image; resample them to the image";
            self.note("labels", Weight::Wrong, text);
        }
        for side in [
            [Tissue::AdiposeRight, Tissue::FibroglandularRight],
            [Tissue::AdiposeLeft, Tissue::FibroglandularLeft],
        ] {
            if !labels.values.iter().any(|tissue| side.contains(tissue)) {
                let [fat, gland] = side.map(Tissue::label);
                let text = format!("no voxel of label {fat} or {gland}: a breast is missing");
                self.note("labels", Weight::Wrong, text);
            }
        }
        if let Some(face) = cut_breast(labels) {
            let text = format!("a breast is cut by the {face} border of the image");
            self.note("labels", Weight::Wrong, text);
        }
    }

    fn landmarks(&mut self, landmarks: &Landmarks, grid: Option<&Grid>) {
        let before = self.found.len();
        if let Some(grid) = grid {
            for (name, point) in &landmarks.0 {
                let voxel = grid.to_voxel().apply(point);
                let inside =
                    (0..3).all(|n| voxel[n] >= -0.5 && voxel[n] <= grid.shape[n] as f64 - 0.5);
                if !inside {
                    let text = format!(
                        "{name} ({:.1}, {:.1}, {:.1}) mm lies outside of the image; give positions \
                         in RAS mm of this image",
                        point.x, point.y, point.z
                    );
                    self.note("landmarks", Weight::Wrong, text);
                }
            }
        }
        for (right, r) in &landmarks.0 {
            let left = right.replace("right", "left");
            let Some(l) = landmarks.0.get(&left).filter(|_| *right != left) else { continue };
            if r.x <= l.x {
                let text = format!(
                    "{right} (x = {:.1} mm) lies left of {left} (x = {:.1} mm), but +x is the \
                     person's right: names or image are mirrored",
                    r.x, l.x
                );
                self.note("landmarks", Weight::Wrong, text);
            }
        }
        if self.found.len() == before {
            let text = format!("{} landmarks, inside of the image", landmarks.0.len());
            self.note("landmarks", Weight::Good, text);
        }
    }
}

/// The registration of each pose starts from chest-wall landmarks that the reference has too.
fn common_landmarks(study: &Study, marked: &[(&String, Landmarks)]) -> Vec<Finding> {
    let reference = study.model.reference_pose.as_deref().unwrap_or("supine");
    let Some((_, fixed)) = marked.iter().find(|(name, _)| *name == reference) else {
        return Vec::new();
    };
    let others = marked.iter().filter(|(name, _)| *name != reference);
    let few = others.filter_map(|(name, landmarks)| {
        let count = landmarks.pairs(fixed, "chest_").len();
        (count < CHEST_LANDMARKS).then(|| Finding {
            key: format!("poses.{name}.landmarks"),
            weight: Weight::Warning,
            text: format!(
                "{count} of the landmarks chest_... are also in poses.{reference}; with \
                 {CHEST_LANDMARKS} the registration starts from them"
            ),
        })
    });
    few.collect()
}

/// Markers on the breasts test how far tissue slides along the skin; a study without them works.
fn missing_fiducials(study: &Study, marked: &[(&String, Landmarks)]) -> Vec<Finding> {
    let reference = study.reference_pose();
    let of =
        |pose: &str| marked.iter().find(|(name, _)| *name == pose).map(|(_, landmarks)| landmarks);
    let none = |name: &&String| match (of(reference), of(name)) {
        (Some(fixed), Some(own)) => fiducials::pairs(fixed, own).is_empty(),
        _ => true,
    };
    let others = study.poses.keys().filter(|name| *name != reference);
    let finding = |name: &String| Finding {
        key: format!("poses.{name}.landmarks"),
        weight: Weight::Warning,
        text: format!(
            "none of the landmarks breast_... and nipple_... is also in poses.{reference}; with them the \
             results say how far the model is off along the skin, which distances of skins do not show"
        ),
    };
    others.filter(none).map(finding).collect()
}

fn grid(summary: &Summary) -> Grid {
    let at = |row: usize, column: usize| summary.affine[row][column];
    Grid {
        shape: summary.dims,
        axes: mammotwin_data::Mat3::from_fn(at),
        origin: mammotwin_data::Vec3::from_fn(|row, _| at(row, 3)),
    }
}

/// Whether the corners of two grids are the same within a tenth of a voxel.
fn same_place(a: &Grid, b: &Grid) -> bool {
    let least = a.spacing_mm().into_iter().fold(f64::MAX, f64::min);
    let corners = |grid: &Grid| {
        let [i, j, k] = grid.shape.map(|n| n - 1);
        [[0, 0, 0], [i, 0, 0], [0, j, 0], [0, 0, k], [i, j, k]].map(|v| grid.center(v))
    };
    let apart = corners(a).into_iter().zip(corners(b)).map(|(p, q)| (p - q).norm());
    a.shape == b.shape && apart.fold(0.0, f64::max) < 0.1 * least
}

/// Area (mm²) of breast on the front border that means a cut breast.
const CUT_FRONT_MM2: f64 = 500.0;
/// The same on the left and right borders, where the fat of the flank may touch.
const CUT_SIDE_MM2: f64 = 3000.0;

/// A border that cuts gland and fat of a breast; upper and lower borders may cut the torso, whose
/// fat beside the breasts is labelled like them.
fn cut_breast(labels: &Volume<Tissue>) -> Option<&'static str> {
    let grid = &labels.grid;
    let mut area = [0.0; 3];
    for (n, _) in labels.values.iter().enumerate().filter(|(_, tissue)| tissue.is_breast()) {
        let voxel = grid.voxel(n);
        for axis in 0..3 {
            let end = match voxel[axis] {
                0 => -1.0,
                v if v + 1 == grid.shape[axis] => 1.0,
                _ => continue,
            };
            let outward = end * grid.axes.column(axis);
            let world = outward.iamax();
            let face_mm2 = grid.voxel_mm3() / outward.norm();
            match (world, outward[world] > 0.0) {
                (0, false) => area[0] += face_mm2,
                (0, true) => area[1] += face_mm2,
                (1, true) => area[2] += face_mm2,
                _ => {}
            }
        }
    }
    let borders = [("left", CUT_SIDE_MM2), ("right", CUT_SIDE_MM2), ("front", CUT_FRONT_MM2)];
    let cut = borders.into_iter().zip(area).find(|((_, allowed), area)| area > allowed);
    cut.map(|((name, _), _)| name)
}

#[cfg(test)]
mod tests;
