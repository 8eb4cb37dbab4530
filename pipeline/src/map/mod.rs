//! A place of tissue in all poses, between the plates and on the mammogram, with what is uncertain about it.

mod spread;

pub use spread::Spread;

use crate::graph::{self, Outcome};
use mammotwin_data::{
    Failure, Vec3,
    io::landmarks,
    rigid::RigidTransform,
    store::{Run, Stored},
    study::{CompressPlan, MammogramPlan, Study, Use},
};
use mammotwin_imaging::xray::{calibration::Unit, geometry::Geometry};
use mammotwin_stages::{
    calibrate::Calibration,
    compress::Compression,
    fiducials::on_breast,
    mesh::BreastMesh,
    place::{Carrier, Places, Shape, Shapes, Unplaced},
    pose::PoseFit,
    register::Registered,
    stiffer::Varied,
};
use serde::Serialize;
use std::{collections::BTreeMap, path::Path};

/// What a run found, as far as places are concerned.
pub struct Body {
    /// Name of the reference pose.
    pub reference: String,
    mesh: BreastMesh,
    calibration: Calibration,
    compression: Option<Compression>,
    start_pose: Option<String>,
    registered: BTreeMap<String, Registered>,
    held_out: Vec<String>,
    fits: BTreeMap<String, PoseFit>,
    shapes: Shapes,
    markers: Vec<spread::Marker>,
    /// The same with moduli one standard deviation higher.
    pub stiffer: Option<Shapes>,
    unit: Option<Geometry>,
}

/// A place in one shape.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// `stress_free`, the name of a pose, `compressed`.
    pub shape: String,
    /// What the coordinates belong to.
    pub frame: &'static str,
    /// The place (mm).
    pub mm: Vec3,
    /// The same place in the frame of the reference pose (mm); absent for a compressed breast.
    pub in_reference_frame_mm: Option<Vec3>,
    /// How sure it is.
    pub spread: Spread,
}

/// A shadow on the detector.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Shadow {
    /// x along the chest-wall edge, y away from it (mm).
    pub detector_mm: [f64; 2],
    /// Column and row from 0, as in the TIFF; not whole.
    pub pixel: [f64; 2],
    /// One standard deviation (mm on the detector, root mean square length).
    pub spread_mm: f64,
    /// Whether the detector reaches so far.
    pub on_detector: bool,
}

/// A place of tissue everywhere.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mapped {
    /// Which breast.
    pub side: &'static str,
    /// How far (mm) the point lies outside of the tissue; its surface was taken.
    pub outside_mm: f64,
    /// Shape after shape.
    pub rows: Vec<Row>,
    /// On the mammogram.
    pub mammogram: Option<Shadow>,
}

/// What a map needs beside a finished study: the fit of the stiffer model, and its compression where there is one.
pub type StifferBody = (Stored<Calibration>, Option<Stored<Compression>>);

/// Runs the stages of that.
///
/// # Errors
/// As of the stages.
pub fn stiffer(study: &Study, run: &Run<'_>) -> Result<StifferBody, Failure> {
    let outcome = graph::body(study, run)?;
    let fit = graph::stiffer(study, &outcome, run)?;
    let press = |plan| graph::varied(study, (Varied::Moduli, plan), "", run, (&outcome.mesh, &fit));
    let pressed = study.compress.as_ref().map(press).transpose()?;
    Ok((fit, pressed))
}

impl Body {
    /// Loads what a run found.
    ///
    /// # Errors
    /// [`Failure::BadInput`] when the study was not run: it says with which command it is.
    pub fn load(
        study: &Study,
        base: &Path,
        command: &str,
        outcome: &Outcome,
    ) -> Result<Self, Failure> {
        let Outcome { reference, measured, mesh, calibration, validations, squeezed, .. } = outcome;
        let targets = measured.targets(study);
        let pending = targets.iter().filter(|target| target.registered.is_pending()).count()
            + validations.values().filter(|validation| validation.is_pending()).count()
            + usize::from(mesh.is_pending())
            + usize::from(calibration.is_pending())
            + usize::from(squeezed.as_ref().is_some_and(|part| part.compression.is_pending()));
        if pending > 0 {
            let text = format!("map: the study was not run as it is now; run it first: {command}");
            return Err(Failure::BadInput(text));
        }
        let calibration = calibration.load()?;
        let compression = squeezed.as_ref().map(|part| part.compression.load()).transpose()?;
        let mut shapes = Shapes::of(&calibration.after, compression.as_ref());
        let mut fits: BTreeMap<String, PoseFit> = BTreeMap::new();
        for fit in &calibration.after.poses {
            fits.insert(fit.pose.clone(), fit.clone());
        }
        for (name, validation) in validations {
            let after = validation.load()?.after;
            shapes.poses.insert(name.clone(), after.solution.points.clone());
            fits.insert(name.clone(), after);
        }
        let mut registered = BTreeMap::new();
        for target in targets {
            registered.insert(target.name.clone(), target.registered.load()?);
        }
        let held_out = |name: &&String| study.usage(name) == Some(Use::Validate);
        let mut body = Self {
            markers: Vec::new(),
            reference: reference.clone(),
            mesh: mesh.load()?,
            held_out: validations.keys().filter(held_out).cloned().collect(),
            start_pose: study.compress.as_ref().and_then(CompressPlan::stress_free_pose),
            calibration,
            compression,
            registered,
            fits,
            shapes,
            stiffer: None,
            unit: study.mammogram.as_ref().map(geometry).transpose()?,
        };
        body.markers = body.carried_markers(study, base)?;
        Ok(body)
    }

    /// Landmarks of the skin that two poses have, carried from each to each other.
    fn carried_markers(&self, study: &Study, base: &Path) -> Result<Vec<spread::Marker>, Failure> {
        let mut marks: BTreeMap<&str, BTreeMap<String, Vec3>> = BTreeMap::new();
        for (name, pose) in &study.poses {
            let Some(path) = &pose.landmarks else { continue };
            let motion = self.to_reference(name);
            let read = landmarks::read(&base.join(path))?.0.into_iter();
            let own = read.filter(|(mark, _)| on_breast(mark)).map(|(m, p)| (m, motion.point(&p)));
            marks.insert(name, own.collect());
        }
        let mut found = Vec::new();
        for (from, own) in &marks {
            let shape = Shape::Pose((*from).to_owned());
            let points: Vec<Vec3> = own.values().copied().collect();
            let carried = self.carrier(&self.shapes).carry(&shape, &points);
            for ((mark, at), places) in own.iter().zip(carried) {
                let Ok(places) = places else { continue };
                for (to, others) in marks.iter().filter(|(to, _)| *to != from) {
                    let Some((there, place)) = others.get(mark).zip(places.poses.get(*to)) else {
                        continue;
                    };
                    found.push(spread::Marker {
                        from: (*from).to_owned(),
                        to: (*to).to_owned(),
                        side: places.side,
                        at: *at,
                        off_mm: (place - there).norm(),
                    });
                }
            }
        }
        Ok(found)
    }

    /// From the image of a pose to the frame of the reference pose.
    fn to_reference(&self, pose: &str) -> RigidTransform {
        let found = self.registered.get(pose);
        found.map_or_else(RigidTransform::identity, |registered| registered.transform)
    }

    /// The shape that a question names.
    ///
    /// # Errors
    /// A name that is none.
    pub fn shape(&self, from: &str) -> Result<Shape, Failure> {
        match from {
            "compressed" | "mammogram" if self.compression.is_some() => Ok(Shape::Pressed),
            "compressed" | "mammogram" => {
                Err(Failure::BadInput(format!("--from {from}: the study has no [compress]")))
            }
            pose if self.shapes.poses.contains_key(pose) => Ok(Shape::Pose(pose.into())),
            other => {
                let mut known: Vec<&str> = self.shapes.poses.keys().map(String::as_str).collect();
                known.extend(["compressed", "mammogram"]);
                let known = known.join(", ");
                Err(Failure::Usage(format!("--from {other}: no such place; there are: {known}")))
            }
        }
    }

    fn carrier<'a>(&'a self, shapes: &'a Shapes) -> Carrier<'a> {
        Carrier {
            mesh: &self.mesh.mesh,
            part: self.compression.as_ref().map(|found| &found.mesh),
            start_pose: self.start_pose.as_deref(),
            shapes,
        }
    }

    /// Carries points (mm): of the image of a pose, or of the frame of the detector.
    pub fn map(&self, from: &Shape, points: &[Vec3]) -> Vec<Result<Mapped, Unplaced>> {
        let motion = match from {
            Shape::Pose(name) => self.to_reference(name),
            _ => RigidTransform::identity(),
        };
        let moved: Vec<Vec3> = points.iter().map(|p| motion.point(p)).collect();
        let found = self.carrier(&self.shapes).carry(from, &moved);
        let other: Vec<Option<Places>> = match &self.stiffer {
            Some(shapes) => {
                let carried = self.carrier(shapes).carry(from, &moved);
                carried.into_iter().map(Result::ok).collect()
            }
            None => points.iter().map(|_| None).collect(),
        };
        let back = |error: Unplaced| match error {
            Unplaced::Outside { mm, nearest } => {
                Unplaced::Outside { mm, nearest: motion.inverse().point(&nearest) }
            }
            other => other,
        };
        let one = |(places, stiffer): (Result<Places, Unplaced>, Option<Places>)| {
            places.map(|places| self.rows(from, &places, stiffer.as_ref())).map_err(back)
        };
        found.into_iter().zip(other).map(one).collect()
    }

    fn rows(&self, from: &Shape, places: &Places, stiffer: Option<&Places>) -> Mapped {
        let side = places.side;
        let errors = spread::Errors { body: self, from, side, places };
        let mut rows = vec![Row {
            shape: "stress_free".into(),
            frame: "reference pose",
            mm: places.rest,
            in_reference_frame_mm: Some(places.rest),
            spread: errors.of(&Shape::Free, &places.rest, stiffer.map(|p| p.rest)),
        }];
        for (name, place) in &places.poses {
            let shape = Shape::Pose(name.clone());
            let moved = stiffer.and_then(|places| places.poses.get(name)).copied();
            rows.push(Row {
                shape: name.clone(),
                frame: "image of the pose",
                mm: self.to_reference(name).inverse().point(place),
                in_reference_frame_mm: Some(*place),
                spread: errors.of(&shape, place, moved),
            });
        }
        let mut mammogram = None;
        if let Some(place) = places.pressed {
            let moved = stiffer.and_then(|places| places.pressed);
            let spread = errors.of(&Shape::Pressed, &place, moved);
            rows.push(Row {
                shape: "compressed".into(),
                frame: "detector",
                mm: place,
                in_reference_frame_mm: None,
                spread,
            });
            mammogram = self.unit.as_ref().map(|unit| shadow(unit, &place, spread.total_mm));
        }
        Mapped { side: side.name(), outside_mm: places.outside_mm, rows, mammogram }
    }

    /// Points (mm, frame of the detector) of the compressed breast on the line from a pixel to the focal spot,
    /// upwards from the receptor, each `step_mm`.
    ///
    /// # Errors
    /// A pixel that is none, or behind which there is no breast.
    pub fn line(&self, pixel: [f64; 2], step_mm: f64) -> Result<Vec<Vec3>, Failure> {
        let (Some(unit), Some(found)) = (&self.unit, &self.compression) else {
            let text = "--from mammogram: the study has no [compress] with a [mammogram]";
            return Err(Failure::BadInput(text.into()));
        };
        let [column, row] = pixel;
        let within = |v: f64, count: usize| (-0.5..=count as f64 - 0.5).contains(&v);
        if !(within(column, unit.columns) && within(row, unit.rows)) {
            return Err(Failure::Usage(format!(
                "--pixel {column},{row}: the picture has {} columns and {} rows",
                unit.columns, unit.rows
            )));
        }
        let foot = Vec3::new(
            unit.left_mm() + column * unit.pitch_mm,
            unit.first_row_mm() + row * unit.pitch_mm,
            0.0,
        );
        let focus = Vec3::new(0.0, 0.0, unit.source_height_mm);
        let up = (focus - foot) / unit.source_height_mm;
        let points = &found.solution.points;
        let top = points.iter().map(|p| p.z).fold(0.0, f64::max);
        let finder = mammotwin_solver::mesh::locate::Locator::new(points, &found.mesh.tets);
        let rise = step_mm / up.norm();
        let count = (top / rise) as usize + 1;
        let along = (0..count).map(|n| foot + (n as f64 + 0.5) * rise * up);
        let held: Vec<Vec3> = along.filter(|p| finder.find(p).is_some()).collect();
        if held.is_empty() {
            return Err(Failure::BadInput(format!(
                "--pixel {column},{row}: no breast lies between this pixel and the focal spot"
            )));
        }
        Ok(held)
    }

    /// Where the numbers of the spread come from, line after line.
    pub fn sources(&self) -> Vec<String> {
        spread::sources(self)
    }
}

fn geometry(plan: &MammogramPlan) -> Result<Geometry, Failure> {
    let unit = Unit::of(plan).map_err(|cause| Failure::BadInput(format!("mammogram: {cause}")))?;
    Ok(unit.geometry)
}

/// The shadow of a point (mm); two of three directions of its error are seen, magnified.
fn shadow(unit: &Geometry, place: &Vec3, spread_mm: f64) -> Shadow {
    let [x, y] = unit.shadow_mm(place);
    let column = (x - unit.left_mm()) / unit.pitch_mm;
    let row = (y - unit.first_row_mm()) / unit.pitch_mm;
    let within = |v: f64, count: usize| (-0.5..=count as f64 - 0.5).contains(&v);
    let magnification = unit.source_height_mm / (unit.source_height_mm - place.z);
    Shadow {
        detector_mm: [x, y],
        pixel: [column, row],
        spread_mm: magnification * (2.0_f64 / 3.0).sqrt() * spread_mm,
        on_detector: within(column, unit.columns) && within(row, unit.rows),
    }
}
