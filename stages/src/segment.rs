//! An image of a pose to labels.

use crate::align::Start;
use mammotwin_data::{Failure, labels::LabelMap, progress::Progress, store::Stage, volume::Volume};
use mammotwin_imaging::mri::segment;
use serde::Serialize;

/// Labels one image without help.
#[derive(Debug, Clone, Serialize)]
pub struct Segment;

impl Stage for Segment {
    const NAME: &'static str = "segment";
    const VERSION: u32 = 3;
    const METHODS: &'static str = "Images were segmented automatically after correction of the coil shading: body by \
         threshold, chest wall as an optimal smooth surface between fat and muscle, gland by \
         clustering.";
    type Input = (Volume<f32>, Option<Start>);
    type Output = LabelMap;

    fn run(
        &self,
        (image, start): &Self::Input,
        progress: &dyn Progress,
    ) -> Result<LabelMap, Failure> {
        let mut options = segment::Options::default();
        if let Some(start) = start {
            options.body_frame = start.transform;
        }
        let found = segment::segment(image, &options, progress)
            .map_err(|cause| Failure::BadInput(format!("segmentation: {cause}")))?;
        Ok(found.labels)
    }
}
