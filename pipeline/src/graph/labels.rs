//! Where the labels of an image come from.

use mammotwin_data::{
    Failure,
    labels::{LabelMap, RawLabels, Scribbles},
    store::{Run, Stored},
    study::Pose,
    volume::Volume,
};
use mammotwin_stages::{align::Start, relabel::Relabel, segment::Segment};

/// Labels of an image: those that are given, or those that are found.
pub(super) fn of_pose(
    name: &str,
    pose: &Pose,
    scan: &Stored<Volume<f32>>,
    start: Option<&Stored<Start>>,
    run: &Run<'_>,
) -> Result<Stored<LabelMap>, Failure> {
    let key = format!("poses.{name}.labels");
    match (&pose.labels, &pose.label_map) {
        (Some(path), None) => run.external(&key, path),
        (Some(path), Some(map)) => {
            let raw: Stored<RawLabels> = run.external(&key, path)?;
            run.stage(name, &Relabel { map: map.clone() }, &raw)
        }
        (None, _) => {
            let key = format!("poses.{name}.scribbles");
            let scribbles: Option<Stored<Scribbles>> =
                pose.scribbles.as_ref().map(|path| run.external(&key, path)).transpose()?;
            let inputs = (scan, start, scribbles.as_ref());
            run.editable(&format!("labels/{name}"), name, &Segment, inputs)
        }
    }
}
