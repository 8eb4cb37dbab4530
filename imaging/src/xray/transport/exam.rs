//! A compressed breast in a mammography unit: dose to its gland, scatter on the detector.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    geometry::Geometry,
    spectrum::{MGY_PER_KEV_PER_G, Spectrum},
    transport::{
        grid::{Grid, GridPlan},
        media::Media,
        photon::{Histories, transport},
        scene::{Block, Body, Bounds, Scene, SceneError, volumes_mm3},
        source::{Source, SourceError, Window},
        tally::{Estimate, Image, Receptor, Scoring, Tally},
    },
};
use mammotwin_data::Vec3;

/// Indices of the materials of a body: air, skin, tissue.
pub const MEDIA: [usize; 3] = [0, 1, 2];
/// Material of the plates.
const PLATE: usize = 3;
/// First of the materials of [`Setup::inclusions`].
pub const INCLUSIONS: usize = 4;
/// Where along y (mm) the incident air kerma is reckoned: Dance (1990) has it 40 mm from the wall.
const KERMA_AT_MM: f64 = 40.0;
/// Cells (mm) of the field that are lit or not.
const CELL_MM: f64 = 4.0;
/// Cells around the shadow of the breast that are lit as well, for the paddle's scatter.
const MARGIN_CELLS: usize = 2;
/// Lattice (mm) that the volume of tissue is counted on.
const LATTICE_MM: f64 = 1.0;

/// Why there is no dose and no scatter.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExamError {
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// The scene is impossible.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The source is impossible.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// No gland.
    #[error(
        "no gland in front of the detector's edge: a mean glandular dose needs some tissue with \
         glandularity above 0"
    )]
    NoGland,
    /// Too thick for its source.
    #[error("the paddle at {0} mm is not below the focal spot")]
    AboveSource(f64),
}

/// Unit around the breast.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Thickness (mm) of the paddle, polycarbonate; 0: none.
    pub paddle_mm: f64,
    /// Distance (mm) from the lower side of the breast to the plane where photons are caught.
    pub gap_mm: f64,
    /// Height (mm) that the incident air kerma is reckoned at: the nominal thickness; the upper side
    /// of the breast's box when absent.
    pub kerma_height_mm: Option<f64>,
    /// What the skin is made of.
    pub skin: Material,
    /// Tissue.
    pub tissue: Material,
    /// Materials of what else is in the body, whose indices begin with [`INCLUSIONS`].
    pub inclusions: Vec<Material>,
    /// Whether a grid lies on the detector; scatter without it is reported in any case.
    pub grid: bool,
    /// Cells of the scatter image along x and y; none: no image.
    pub cells: Option<[usize; 2]>,
}

impl Setup {
    /// Breast tissue with this mass fraction of gland, in a usual unit: paddle of 2.5 mm, 15 mm
    /// from the breast to the detector, grid, scatter in cells of about 5 mm on a field of
    /// 285 x 239 mm. The breast support (carbon fibre, 1 - 2 mm) is left out.
    pub fn usual(glandularity: f64) -> Result<Self, AttenuationError> {
        Ok(Self {
            paddle_mm: 2.5,
            gap_mm: 15.0,
            kerma_height_mm: None,
            skin: Material::named("skin_hammerstein")?,
            tissue: Material::breast(glandularity)?,
            inclusions: Vec::new(),
            grid: true,
            cells: Some([57, 48]),
        })
    }
}

/// What the photons did.
#[derive(Debug, Clone, PartialEq)]
pub struct Exam {
    /// Mean dose (mGy) of the gland per incident air kerma (mGy): g c s in one.
    pub dose_per_kerma: Estimate,
    /// Gland (g) in front of the detector's edge.
    pub gland_g: f64,
    /// Share of the emitted photons that met the breast.
    pub entered: f64,
    /// Where photons were caught, if asked for.
    pub receptor: Option<Receptor>,
    /// Counts.
    pub tally: Tally,
}

impl Exam {
    /// Scatter-to-primary ratio of cells whose centre is counted (mm), without grid.
    pub fn scatter_to_primary(&self, counts: impl Fn(f64, f64) -> bool) -> Option<Estimate> {
        self.ratio(&self.tally.bare, counts)
    }

    /// The same behind the grid.
    pub fn behind_grid(&self, counts: impl Fn(f64, f64) -> bool) -> Option<Estimate> {
        self.ratio(&self.tally.behind_grid, counts)
    }

    fn ratio(&self, image: &Image, counts: impl Fn(f64, f64) -> bool) -> Option<Estimate> {
        let receptor = self.receptor.filter(|_| !image.primary.is_empty())?;
        let ratio = image.scatter_to_primary(|n| {
            let [x, y] = receptor.center(n);
            counts(x, y)
        });
        ratio.mean.is_finite().then_some(ratio)
    }
}

/// X-rays a breast. As in Dance's model the beam may come filtered by the paddle
/// ([`Spectrum::behind`]) with a setup that has none; the scatter of a paddle in the setup adds to
/// the dose, and not to the kerma.
///
/// The body is made of [`MEDIA`] and [`INCLUSIONS`] and stands on the plane z = 0, from which the
/// height of the focal spot is measured.
///
/// Gland counts in front of the edge of the detector (y > 0). The incident air kerma is that of
/// photons straight from the focal spot, behind the paddle, 40 mm from the edge.
pub fn examine<B: Body>(
    body: B,
    setup: &Setup,
    geometry: &Geometry,
    spectrum: &Spectrum,
    histories: Histories,
) -> Result<Exam, ExamError> {
    let air = Material::named("air")?;
    let plate = Material::named("polycarbonate")?;
    let mut materials = vec![air, setup.skin.clone(), setup.tissue.clone(), plate];
    materials.extend(setup.inclusions.iter().cloned());
    let media = Media::new(materials)?;
    let around = body.bounds();
    let detector = Source::of(geometry, spectrum);
    let height = detector.position.z;
    let top = around.high.z;
    if !(top + setup.paddle_mm < height) {
        return Err(ExamError::AboveSource(top));
    }
    let source = aimed(&detector, &body).ok_or(ExamError::NoGland)?;
    let mut blocks = Vec::new();
    if setup.paddle_mm > 0.0 {
        let bounds = Bounds::of(detector.x, detector.y, [top, top + setup.paddle_mm]);
        blocks.push(Block { bounds, medium: PLATE });
    }
    let floor = around.low.z - setup.gap_mm;
    let world = Bounds::of(
        [detector.x[0].min(around.low.x) - 1.0, detector.x[1].max(around.high.x) + 1.0],
        [around.low.y.min(0.0) - 1.0, detector.y[1].max(around.high.y) + 1.0],
        [floor - 1.0, height + 1.0],
    );
    let receptor =
        setup.cells.map(|cells| Receptor { x: detector.x, y: detector.y, z: floor, cells });
    let scene = Scene::new(media, MEDIA[0], world, body, &blocks)?;
    let volumes = volumes_mm3(&scene.body, LATTICE_MM, |p| p.y >= 0.0);
    let of = |(material, volume): (&Material, &f64)| {
        1e-3 * volume * material.density_g_per_cm3 * material.glandularity()
    };
    let gland_g: f64 = scene.media.materials().iter().zip(&volumes).map(of).sum();
    if !(gland_g > 0.0) {
        return Err(ExamError::NoGland);
    }
    let grid =
        if setup.grid { Some(Grid::new(&GridPlan::linear(source.position)?)?) } else { None };
    let scoring = Scoring { boxes: vec![], receptor, from_y_mm: 0.0 };
    let tally = transport(&scene, &source, &scoring, grid.as_ref(), histories)?;
    let kerma_height = setup.kerma_height_mm.unwrap_or(top);
    let kerma = kerma_per_photon(&source, setup.paddle_mm, kerma_height)?;
    Ok(Exam {
        dose_per_kerma: tally.gland.times(MGY_PER_KEV_PER_G / gland_g / kerma),
        gland_g,
        entered: tally.entered as f64 / tally.photons as f64,
        receptor,
        tally,
    })
}

/// Lights the shadow of a body and [`MARGIN_CELLS`] around it: photons beside it would only reach
/// the breast by way of air or paddle. `None`: no shadow in the field.
fn aimed<B: Body>(detector: &Source, body: &B) -> Option<Source> {
    let height = detector.position.z;
    let around = body.bounds();
    let cells =
        [detector.x, detector.y].map(|[low, high]| ((high - low) / CELL_MM).ceil() as usize);
    let mut lit = vec![false; cells[0] * cells[1]];
    // Points closer than the cells, so that the shadow has no holes.
    let size = around.high - around.low;
    let steps = size.map(|size| (size / LATTICE_MM).ceil().max(1.0));
    let place = |k: usize, n: usize| around.low[k] + (n as f64 + 0.5) / steps[k] * size[k];
    for k in 0..steps.z as usize {
        for j in 0..steps.y as usize {
            for i in 0..steps.x as usize {
                let point = Vec3::new(place(0, i), place(1, j), place(2, k));
                let scale = height / (height - point.z);
                let cell = detector.cell(cells, point.x * scale, point.y * scale);
                if let Some(cell) = cell.filter(|&cell| !lit[cell]) {
                    lit[cell] = body.medium(&point) != MEDIA[0];
                }
            }
        }
    }
    let window = Window { cells, lit }.widened(MARGIN_CELLS);
    Source { window: Some(window), ..detector.clone() }.cropped()
}

/// Incident air kerma (mGy) of one photon emitted into the field.
fn kerma_per_photon(source: &Source, paddle_mm: f64, top: f64) -> Result<f64, AttenuationError> {
    let ray = source.position - Vec3::new(0.0, KERMA_AT_MM, top);
    let slant = ray.norm() / ray.z;
    let [air, plate] = [Material::named("air")?, Material::named("polycarbonate")?];
    let behind_air = source.spectrum.behind(&air, ray.norm() - slant * paddle_mm)?;
    let behind = behind_air.behind(&plate, slant * paddle_mm)?;
    let per_mm2 = 1.0 / (source.solid_angle() * ray.norm_squared());
    Ok(per_mm2 * behind.kerma_mgy_mm2(&air, 0.0)?)
}
