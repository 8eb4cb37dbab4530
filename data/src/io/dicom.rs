//! Simulated mammograms as DICOM: Digital Mammography X-Ray Image, For Processing and For
//! Presentation (PS3.3, A.27).
//!
//! No clock is read: dates and times are empty, and unique identifiers are hashes of what they
//! identify, so that equal inputs give equal bytes.

use super::picture::{PictureError, Presentation, attenuation, gain16, hang, save};
use crate::{labels::Side, radiograph::Radiograph, study::View};
use dicom_core::{
    DataElement, PrimitiveValue, Tag, VR,
    value::{DataSetSequence, Value},
};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{InMemDicomObject, meta::FileMetaTableBuilder};
use std::path::Path;

/// What the pixels are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Intent {
    /// Detector signal, linear: more photons, larger values.
    Processing,
    /// 1000 ln(brightest signal / signal), with a window: denser is brighter.
    Presentation,
}

/// What a mammogram is of, and how it was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Acquisition {
    /// Pseudonym of the person.
    pub subject: String,
    /// What sets this picture apart from others of the same breast.
    pub description: String,
    /// Number of the picture among them, from 1.
    pub number: u32,
    /// Which breast.
    pub side: Side,
    /// From where.
    pub view: View,
    /// Distance of the plates (mm).
    pub thickness_mm: f64,
    /// Focal spot to detector (mm).
    pub source_height_mm: f64,
    /// Tube voltage (kV) of the beam that the dose was computed for.
    pub tube_kv: f64,
    /// Its half-value layer (mm Al).
    pub hvl_mm_al: f64,
    /// Incident air kerma (mGy).
    pub kerma_mgy: f64,
    /// Average glandular dose (mGy).
    pub agd_mgy: f64,
}

/// Writes a picture as a DICOM file (explicit little endian), hung as mammograms are: see
/// [`write_presentation`](super::picture::write_presentation).
///
/// For processing, values are the signal times the largest power of two that lets its brightest pixel
/// fit into 16 bits; that factor is in the image comments.
///
/// # Errors
/// When an attribute cannot be encoded or the file system refuses.
pub fn write_mammogram(
    path: &Path,
    signal: &Radiograph,
    acquisition: &Acquisition,
    intent: Intent,
) -> Result<(), PictureError> {
    let failed = |cause: String| PictureError { path: path.into(), cause };
    let object = object(signal, acquisition, intent);
    let meta = FileMetaTableBuilder::new().transfer_syntax(uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let file = object.with_meta(meta).map_err(|e| failed(e.to_string()))?;
    save(path, |out| file.write_all(out).map_err(|e| e.to_string()))
}

/// Attributes by tag.
struct Attributes(InMemDicomObject);

impl Attributes {
    fn text(&mut self, tag: Tag, vr: VR, text: &str) {
        self.0.put(DataElement::new(tag, vr, text));
    }

    fn number(&mut self, tag: Tag, number: u16) {
        self.0.put(DataElement::new(tag, VR::US, PrimitiveValue::from(number)));
    }

    /// At most 16 characters, as decimal strings are.
    fn decimal(&mut self, tag: Tag, number: f64) {
        self.text(tag, VR::DS, &brief(number));
    }

    fn empty(&mut self, tag: Tag, vr: VR) {
        self.0.put(DataElement::new(tag, vr, PrimitiveValue::Empty));
    }

    fn sequence(&mut self, tag: Tag, items: Vec<InMemDicomObject>) {
        let items = Value::Sequence(DataSetSequence::from(items));
        self.0.put(DataElement::new(tag, VR::SQ, items));
    }
}

/// A decimal string of at most 16 characters.
fn brief(number: f64) -> String {
    let plain = number.to_string();
    if plain.len() <= 16 { plain } else { format!("{number:.8e}") }
}

/// Texts are short strings without the separator of several values.
fn label(text: &str) -> String {
    text.chars()
        .filter(|c| c.is_ascii_graphic() || *c == ' ')
        .filter(|c| *c != '\\')
        .take(64)
        .collect()
}

/// A unique identifier: a hash as a whole number below 2.25 (PS3.5, B.2).
fn uid(parts: &[&[u8]]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
    format!("2.25.{}", u128::from_be_bytes(bytes))
}

fn code(value: &str, meaning: &str) -> InMemDicomObject {
    let mut item = Attributes(InMemDicomObject::new_empty());
    item.text(tags::CODE_VALUE, VR::SH, value);
    item.text(tags::CODING_SCHEME_DESIGNATOR, VR::SH, "SCT");
    item.text(tags::CODE_MEANING, VR::LO, meaning);
    item.0
}

/// All attributes of the picture.
fn object(signal: &Radiograph, acquisition: &Acquisition, intent: Intent) -> InMemDicomObject {
    let mut all = Attributes(InMemDicomObject::new_empty());
    let gain = gain16(signal);
    let (stored, bits): (Vec<u16>, u16) = match intent {
        Intent::Processing => {
            let count = |&pixel: &f32| (f64::from(pixel) * gain).round() as u16;
            (signal.pixels.iter().map(count).collect(), 16)
        }
        Intent::Presentation => {
            let level = |a: &f64| (1000.0 * a).round().clamp(0.0, 4095.0) as u16;
            (attenuation(signal).iter().map(level).collect(), 12)
        }
    };
    let hung = hang(&stored, signal, acquisition.side);
    identify(&mut all, acquisition, intent, &hung);
    acquire(&mut all, signal, acquisition);
    pixels(&mut all, signal, (hung, bits), intent);
    let comment = match intent {
        Intent::Processing => format!("Simulated; pixel = {gain} x {}", signal.quantity),
        Intent::Presentation => "Simulated; pixel = 1000 ln(brightest / signal)".into(),
    };
    all.text(tags::IMAGE_COMMENTS, VR::LT, &comment);
    all.0
}

/// Person, study, series, equipment, instance.
fn identify(all: &mut Attributes, of: &Acquisition, intent: Intent, hung: &[u16]) {
    let subject = label(&of.subject);
    let (class, name, series) = match intent {
        Intent::Processing => {
            (uids::DIGITAL_MAMMOGRAPHY_X_RAY_IMAGE_STORAGE_FOR_PROCESSING, "FOR PROCESSING", "1")
        }
        Intent::Presentation => (
            uids::DIGITAL_MAMMOGRAPHY_X_RAY_IMAGE_STORAGE_FOR_PRESENTATION,
            "FOR PRESENTATION",
            "2",
        ),
    };
    let study = ["study", &of.subject].map(str::as_bytes);
    let pixels: Vec<u8> = hung.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();
    let header = format!("{of:?} {intent:?}");
    let study_uid = uid(&study);
    let series_uid = uid(&[b"series", study_uid.as_bytes(), name.as_bytes()]);
    let instance_uid = uid(&[b"instance", header.as_bytes(), &pixels]);
    all.text(tags::SOP_CLASS_UID, VR::UI, class);
    all.text(tags::SOP_INSTANCE_UID, VR::UI, &instance_uid);
    all.text(tags::STUDY_INSTANCE_UID, VR::UI, &study_uid);
    all.text(tags::SERIES_INSTANCE_UID, VR::UI, &series_uid);
    // A family name, no given one.
    all.text(tags::PATIENT_NAME, VR::PN, &format!("{}^", subject.replace('^', " ")));
    all.text(tags::PATIENT_ID, VR::LO, &subject);
    all.text(tags::PATIENT_SEX, VR::CS, "F");
    for (tag, vr) in [
        (tags::PATIENT_BIRTH_DATE, VR::DA),
        (tags::STUDY_DATE, VR::DA),
        (tags::STUDY_TIME, VR::TM),
        (tags::REFERRING_PHYSICIAN_NAME, VR::PN),
        (tags::STUDY_ID, VR::SH),
        (tags::ACCESSION_NUMBER, VR::SH),
    ] {
        all.empty(tag, vr);
    }
    all.text(tags::MODALITY, VR::CS, "MG");
    all.text(tags::PRESENTATION_INTENT_TYPE, VR::CS, name);
    all.text(tags::SERIES_NUMBER, VR::IS, series);
    all.text(tags::INSTANCE_NUMBER, VR::IS, &of.number.to_string());
    all.text(tags::SERIES_DESCRIPTION, VR::LO, &label(&format!("simulated, {name}")));
    all.text(tags::MANUFACTURER, VR::LO, "mammotwin (simulation)");
    all.text(tags::MANUFACTURER_MODEL_NAME, VR::LO, "mammotwin");
    all.text(tags::SOFTWARE_VERSIONS, VR::LO, env!("CARGO_PKG_VERSION"));
    all.text(tags::DEVICE_SERIAL_NUMBER, VR::LO, "0");
    all.text(tags::CONTENT_QUALIFICATION, VR::CS, "RESEARCH");
    all.text(tags::ACQUISITION_DEVICE_PROCESSING_DESCRIPTION, VR::LO, &label(&of.description));
}

/// Breast, view, beam, detector, dose.
fn acquire(all: &mut Attributes, signal: &Radiograph, of: &Acquisition) {
    let (side, oriented) = match (of.side, of.view) {
        (Side::Right, View::Cc) => ("R", "P\\L"),
        (Side::Left, View::Cc) => ("L", "A\\R"),
        (Side::Right, View::Mlo) => ("R", "P\\FL"),
        (Side::Left, View::Mlo) => ("L", "A\\FR"),
    };
    let view = match of.view {
        View::Cc => code("399162004", "cranio-caudal"),
        View::Mlo => code("399368009", "medio-lateral oblique"),
    };
    let mut view = Attributes(view);
    view.sequence(tags::VIEW_MODIFIER_CODE_SEQUENCE, vec![]);
    all.sequence(tags::VIEW_CODE_SEQUENCE, vec![view.0]);
    all.sequence(tags::ANATOMIC_REGION_SEQUENCE, vec![code("76752008", "Breast")]);
    all.sequence(tags::ACQUISITION_CONTEXT_SEQUENCE, vec![]);
    all.text(tags::IMAGE_LATERALITY, VR::CS, side);
    all.text(tags::PATIENT_ORIENTATION, VR::CS, oriented);
    all.text(tags::BODY_PART_EXAMINED, VR::CS, "BREAST");
    all.text(tags::ORGAN_EXPOSED, VR::CS, "BREAST");
    all.text(tags::BREAST_IMPLANT_PRESENT, VR::CS, "NO");
    all.text(tags::PARTIAL_VIEW, VR::CS, "NO");
    all.text(tags::POSITIONER_TYPE, VR::CS, "MAMMOGRAPHIC");
    all.empty(tags::POSITIONER_PRIMARY_ANGLE, VR::DS);
    all.decimal(tags::BODY_PART_THICKNESS, of.thickness_mm);
    all.decimal(tags::DISTANCE_SOURCE_TO_DETECTOR, of.source_height_mm);
    all.decimal(tags::DISTANCE_SOURCE_TO_PATIENT, of.source_height_mm);
    all.text(tags::ESTIMATED_RADIOGRAPHIC_MAGNIFICATION_FACTOR, VR::DS, "1");
    all.decimal(tags::KVP, of.tube_kv);
    all.text(tags::ANODE_TARGET_MATERIAL, VR::CS, "RHODIUM");
    all.text(tags::FILTER_TYPE, VR::SH, "STRIP");
    all.text(tags::FILTER_MATERIAL, VR::CS, "SILVER");
    all.text(tags::GRID, VR::CS, "NONE");
    all.decimal(tags::HALF_VALUE_LAYER, of.hvl_mm_al);
    all.decimal(tags::ENTRANCE_DOSE_INM_GY, of.kerma_mgy);
    // In dGy.
    all.decimal(tags::ORGAN_DOSE, of.agd_mgy / 100.0);
    all.text(tags::DETECTOR_TYPE, VR::CS, "SCINTILLATOR");
    let pitch = brief(signal.pitch_mm);
    all.text(tags::IMAGER_PIXEL_SPACING, VR::DS, &format!("{pitch}\\{pitch}"));
    all.text(tags::FIELD_OF_VIEW_SHAPE, VR::CS, "RECTANGLE");
    // Rows of the picture lie along the chest wall after it was turned.
    let side_mm = |count: usize| (count as f64 * signal.pitch_mm).round();
    let field = format!("{}\\{}", side_mm(signal.rows), side_mm(signal.columns));
    all.text(tags::FIELD_OF_VIEW_DIMENSIONS, VR::IS, &field);
    all.text(tags::FIELD_OF_VIEW_ORIGIN, VR::DS, "0\\0");
    let turn = if of.side == Side::Right { "270" } else { "90" };
    all.text(tags::FIELD_OF_VIEW_ROTATION, VR::DS, turn);
    all.text(tags::FIELD_OF_VIEW_HORIZONTAL_FLIP, VR::CS, "NO");
}

/// Pixels and what they mean.
fn pixels(
    all: &mut Attributes,
    signal: &Radiograph,
    (hung, bits): (Vec<u16>, u16),
    intent: Intent,
) {
    all.text(tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY");
    all.text(tags::BURNED_IN_ANNOTATION, VR::CS, "NO");
    all.text(tags::LOSSY_IMAGE_COMPRESSION, VR::CS, "00");
    let (photometric, relationship, sign, shape) = match intent {
        Intent::Processing => ("MONOCHROME1", "LIN", 1, "INVERSE"),
        Intent::Presentation => ("MONOCHROME2", "LOG", -1, "IDENTITY"),
    };
    all.text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, photometric);
    all.text(tags::PIXEL_INTENSITY_RELATIONSHIP, VR::CS, relationship);
    let sign = PrimitiveValue::from(sign as i16);
    all.0.put(DataElement::new(tags::PIXEL_INTENSITY_RELATIONSHIP_SIGN, VR::SS, sign));
    all.text(tags::PRESENTATION_LUT_SHAPE, VR::CS, shape);
    all.text(tags::RESCALE_INTERCEPT, VR::DS, "0");
    all.text(tags::RESCALE_SLOPE, VR::DS, "1");
    all.text(tags::RESCALE_TYPE, VR::LO, "US");
    if intent == Intent::Presentation {
        let Presentation { black, white } = Presentation::of(signal);
        all.decimal(tags::WINDOW_CENTER, (500.0 * (black + white)).round());
        all.decimal(tags::WINDOW_WIDTH, (1000.0 * (white - black)).round().max(1.0));
    }
    all.number(tags::SAMPLES_PER_PIXEL, 1);
    all.number(tags::ROWS, signal.columns as u16);
    all.number(tags::COLUMNS, signal.rows as u16);
    all.number(tags::BITS_ALLOCATED, 16);
    all.number(tags::BITS_STORED, bits);
    all.number(tags::HIGH_BIT, bits - 1);
    all.number(tags::PIXEL_REPRESENTATION, 0);
    all.0.put(DataElement::new(tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(hung.into())));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Radiograph {
        // 3 columns along the chest wall, 2 rows; the brightest needs a gain of a quarter.
        Radiograph {
            columns: 3,
            rows: 2,
            pitch_mm: 0.1,
            left_mm: -0.1,
            first_row_mm: 0.05,
            pixels: vec![4000.0, 8000.0, 12_000.0, 140_000.0, 400.0, 0.0],
            quantity: "counted quanta per pixel".into(),
        }
    }

    fn acquisition(side: Side) -> Acquisition {
        Acquisition {
            subject: "vol\\unteer 1".into(),
            description: "microcalcifications 0.2 mm".into(),
            number: 1,
            side,
            view: View::Cc,
            thickness_mm: 46.123_456_789_012_34,
            source_height_mm: 660.0,
            tube_kv: 34.0,
            hvl_mm_al: 0.535,
            kerma_mgy: 3.2,
            agd_mgy: 1.15,
        }
    }

    fn read(side: Side, intent: Intent) -> (InMemDicomObject, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.dcm");
        write_mammogram(&path, &picture(), &acquisition(side), intent).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        (dicom_object::open_file(&path).unwrap().into_inner(), bytes)
    }

    fn values(object: &InMemDicomObject) -> Vec<u16> {
        object.element(tags::PIXEL_DATA).unwrap().to_multi_int().unwrap()
    }

    #[test]
    fn pixels_for_processing_are_linear_and_hang_as_mammograms() {
        // Right: lateral (last column) on top, chest wall (row 0) at the right.
        let (right, bytes) = read(Side::Right, Intent::Processing);
        assert_eq!(values(&right), [0, 3000, 100, 2000, 35_000, 1000]);
        let (left, _) = read(Side::Left, Intent::Processing);
        assert_eq!(values(&left), [1000, 35_000, 2000, 100, 3000, 0]);
        let of = |tag| right.element(tag).unwrap().to_str().unwrap().into_owned();
        assert_eq!(of(tags::PATIENT_ORIENTATION), "P\\L");
        assert!(of(tags::IMAGE_COMMENTS).contains("0.25 x counted quanta"));
        assert_eq!(of(tags::PATIENT_ID), "volunteer 1");
        assert_eq!(of(tags::BODY_PART_THICKNESS), "4.61234568e1");
        assert_eq!(read(Side::Right, Intent::Processing).1, bytes);
    }

    #[test]
    fn denser_is_brighter_for_presentation() {
        let (shown, _) = read(Side::Left, Intent::Presentation);
        let level = |signal: f64| (1000.0 * (140_000.0 / signal).ln()).round().min(4095.0) as u16;
        let wanted = [4000.0, 140_000.0, 8000.0, 400.0, 12_000.0, 1.0].map(level);
        assert_eq!(values(&shown), wanted);
        assert_eq!(
            shown.element(tags::PHOTOMETRIC_INTERPRETATION).unwrap().to_str().unwrap(),
            "MONOCHROME2"
        );
    }

    #[test]
    fn different_pictures_have_different_identifiers() {
        let id = |side, intent| {
            let (object, _) = read(side, intent);
            object.element(tags::SOP_INSTANCE_UID).unwrap().to_str().unwrap().into_owned()
        };
        let mut all = vec![];
        for side in [Side::Right, Side::Left] {
            all.extend([Intent::Processing, Intent::Presentation].map(|intent| id(side, intent)));
        }
        assert!(all.iter().all(|id| id.len() <= 64));
        all.sort();
        all.dedup();
        assert_eq!(all.len(), 4);
    }
}
