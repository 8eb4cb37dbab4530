//! An image of a pose to labels.

use crate::align::Start;
use mammotwin_data::{
    Failure,
    labels::{LabelMap, Scribbles},
    progress::Progress,
    store::Stage,
    volume::Volume,
};
use mammotwin_imaging::mri::segment;
use serde::Serialize;

/// Labels one image, by itself or taught by what a person marked in it.
#[derive(Debug, Clone, Serialize)]
pub struct Segment;

impl Stage for Segment {
    const NAME: &'static str = "segment";
    const VERSION: u32 = 4;
    const METHODS: &'static str = "Images were segmented automatically after correction of the coil shading: body by \
         threshold, chest wall as an optimal smooth surface between fat and muscle, gland by \
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
        Ok(found.labels)
    }
}
