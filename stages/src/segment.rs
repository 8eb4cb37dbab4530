//! An image of a pose to labels.

use crate::align::Start;
use mammotwin_data::{
    Failure,
    labels::{LabelMap, Scribbles},
    progress::Progress,
    store::{Notes, Stage},
    volume::Volume,
};
use mammotwin_imaging::mri::segment;
use serde::Serialize;
use std::collections::BTreeMap;

/// Name of the note on [`segment::Segmentation::wall_seen`].
pub const WALL_SEEN: &str = "wall_seen";
/// Name of the note on [`segment::Segmentation::muscle_rear_seen`].
pub const REAR_SEEN: &str = "muscle_rear_seen";

/// What the segmentation says of the images that it labelled, by pose.
pub type Segmented = BTreeMap<String, Notes>;

/// Labels one image, by itself or taught by what a person marked in it.
#[derive(Debug, Clone, Serialize)]
pub struct Segment;

impl Stage for Segment {
    const NAME: &'static str = "segment";
    const VERSION: u32 = 8;
    const METHODS: &'static str = "Images were segmented automatically after correction of the coil shading: body by \
         threshold, chest wall as an optimal smooth surface between fat and muscle (bright fat, or suppressed and darker fat), gland by \
         clustering; where a study gives scribbles, the brightness of the tissues was learnt from them.";
    type Input = (Volume<f32>, Option<Start>, Option<Scribbles>);
    type Output = LabelMap;

    fn run(
        &self,
        (image, start, scribbles): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<LabelMap, Failure> {
        let mut options = segment::Options::default();
        if let Some(start) = start {
            options.body_frame = start.transform;
        }
        let found = segment::segment_marked(image, scribbles.as_ref(), &options, progress)
            .map_err(|cause| Failure::BadInput(format!("segmentation: {cause}")))?;
        progress.note(WALL_SEEN, found.wall_seen);
        progress.note(REAR_SEEN, found.muscle_rear_seen);
        found.warnings.iter().for_each(|warning| progress.warn(&warning.to_string()));
        Ok(found.labels)
    }
}
