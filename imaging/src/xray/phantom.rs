//! The numerical phantom: a compressed breast with gland, masses and microcalcifications.

use crate::xray::{
    attenuation::{AttenuationError, Material},
    calcification::{self, sphere},
    inside::Inside,
    placement::{Places, Site},
    raster::RasterError,
    shapes::Ellipsoid,
};
use mammotwin_data::{Vec3, study::MammogramPlan, surface::TriMesh};

/// Times that a sphere is split to try whether a mass lies in the breast: 642 points.
const MASS_SPLITS: usize = 3;

/// Skin (mm): Huang et al. (2008), mean of 51 breasts.
pub const SKIN_MM: f64 = 1.45;

/// Why there is no phantom.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PhantomError {
    /// The compressed surface has no inside.
    #[error("compressed breast: {0}")]
    Surface(#[from] RasterError),
    /// A material has no attenuation.
    #[error(transparent)]
    Material(#[from] AttenuationError),
    /// Nothing of the matrix lies in tissue.
    #[error(
        "no microcalcification lies in tissue: the breast is nowhere about {thickness_mm} mm thick \
         in front of the detector's edge; check thickness and frame"
    )]
    Misplaced {
        /// Nominal thickness (mm).
        thickness_mm: f64,
    },
    /// A microcalcification at a stated place is outside.
    #[error(
        "mammogram.calcifications.center_mm: the microcalcification in row {row}, column {column} at \
         ({:.1}, {:.1}, {:.1}) mm lies outside of the breast", center.x, center.y, center.z
    )]
    CalcificationOutside {
        /// Row in the matrix.
        row: usize,
        /// Column in the matrix.
        column: usize,
        /// Where (mm).
        center: Vec3,
    },
    /// A mass stands out of the breast.
    #[error(
        "mammogram.masses[{number}]: at ({:.1}, {:.1}, {:.1}) mm it stands out of the breast by \
         {beyond_mm:.1} mm; move it or make it smaller", center.x, center.y, center.z
    )]
    MassOutside {
        /// Number in the list.
        number: usize,
        /// Middle (mm).
        center: Vec3,
        /// How far (mm).
        beyond_mm: f64,
    },
    /// Two masses share tissue.
    #[error(
        "mammogram.masses[{first}] and [{second}] may overlap: they are closer than their largest radii"
    )]
    MassesOverlap {
        /// Number in the list.
        first: usize,
        /// Number in the list.
        second: usize,
    },
}

/// One microcalcification.
#[derive(Debug, Clone, PartialEq)]
pub struct Calcification {
    /// Place in the matrix.
    pub site: Site,
    /// Diameter (mm) of the sphere of its volume.
    pub diameter_mm: f64,
    /// Closed surface.
    pub surface: TriMesh,
    /// What it replaces where that is not the tissue of the phantom: gland or a mass.
    pub around: Option<Material>,
}

/// A part of the breast that is not its tissue.
#[derive(Debug, Clone, PartialEq)]
pub struct Inclusion {
    /// Its form.
    pub form: Form,
    /// What it is made of.
    pub material: Material,
}

/// Form of an [`Inclusion`].
#[derive(Debug, Clone, PartialEq)]
pub enum Form {
    /// A closed surface (mm).
    Surface(TriMesh),
    /// An ellipsoid: exact.
    Ellipsoid(Ellipsoid),
}

/// Tissue in a closed surface, inclusions that replace some of it, and microcalcifications that replace
/// some of either (Mîra 2018, § 5.2.2).
#[derive(Debug, Clone, PartialEq)]
pub struct Phantom {
    /// Closed surface, in the frame of the detector (mm).
    pub surface: TriMesh,
    /// Nominal thickness (mm): distance of the plates.
    pub thickness_mm: f64,
    /// Breast tissue; fat where the gland is an inclusion.
    pub tissue: Material,
    /// Gland, if it has a surface, then masses; a later one replaces what it shares with an earlier.
    pub inclusions: Vec<Inclusion>,
    /// What the calcifications are made of.
    pub calcium: Material,
    /// By row, then column; those in tissue only.
    pub calcifications: Vec<Calcification>,
}

impl Phantom {
    /// Fills a compressed breast as the plan says, with calcifications of one diameter. Shapes
    /// depend on the seed and the place in the matrix alone, so phantoms of one seed compare
    /// diameters or paddles on the same shapes.
    ///
    /// With the surface of its gland the rest is fat; without, gland is uniform.
    pub fn new(
        surface: TriMesh,
        gland: Option<&TriMesh>,
        thickness_mm: f64,
        plan: &MammogramPlan,
        diameter_mm: f64,
        seed: u64,
    ) -> Result<Self, PhantomError> {
        let places = Places::of(&surface, thickness_mm)?;
        let matrix = &plan.calcifications;
        let inside = Inside::of(&surface)?;
        // Alike for all diameters, so that they compare.
        let largest_mm = matrix.diameter_mm.iter().copied().fold(diameter_mm, f64::max);
        let buried = |center: &Vec3| inside.depth_mm(center) >= SKIN_MM + 0.5 * largest_mm;
        let sites = places.sites(matrix, &buried);
        if sites.is_empty() && matrix.rows * matrix.columns > 0 {
            return Err(PhantomError::Misplaced { thickness_mm });
        }
        let masses = masses(&inside, &places, plan)?;
        let in_gland = gland.map(Inside::of).transpose()?;
        if matrix.center_mm.is_some() {
            let out = |s: &&Site| inside.depth_mm(&s.center) < 0.5 * diameter_mm;
            if let Some(&Site { row, column, center }) = sites.iter().find(out) {
                return Err(PhantomError::CalcificationOutside { row, column, center });
            }
        }
        let pure = Material::breast(1.0)?;
        let calcify = |site: Site| {
            let shape = seed.wrapping_add((site.row * matrix.columns + site.column) as u64);
            let surface = calcification::irregular(&site.center, diameter_mm, shape);
            let at = &site.center;
            let mass = masses.iter().rev().find(|(form, _)| form.contains(at));
            let gland = || in_gland.as_ref().filter(|g| g.contains(at)).map(|_| pure.clone());
            let around = mass.map(|(_, material)| material.clone()).or_else(gland);
            Calcification { site, diameter_mm, surface, around }
        };
        let calcifications = sites.into_iter().map(calcify).collect();
        let glandularity = if gland.is_some() { 0.0 } else { plan.glandularity };
        let gland = gland.cloned().map(|g| (Form::Surface(g), pure.clone()));
        let masses = masses.into_iter().map(|(form, material)| (Form::Ellipsoid(form), material));
        let inclusions = gland.into_iter().chain(masses);
        Ok(Self {
            surface,
            thickness_mm,
            tissue: Material::breast(glandularity)?,
            inclusions: inclusions.map(|(form, material)| Inclusion { form, material }).collect(),
            calcium: Material::calcification()?,
            calcifications,
        })
    }
}

/// The masses of a plan, each within the breast.
pub fn masses(
    inside: &Inside,
    places: &Places,
    plan: &MammogramPlan,
) -> Result<Vec<(Ellipsoid, Material)>, PhantomError> {
    let mut all: Vec<(Ellipsoid, Material)> = Vec::new();
    for (number, mass) in plan.masses.iter().enumerate() {
        let stated = mass.center_mm.map(Vec3::from);
        let center = match (stated, mass.center_share) {
            (Some(center), _) => center,
            (None, share) => places.at_share(share.unwrap_or([0.5; 3])),
        };
        let form = Ellipsoid { center, radii: Vec3::from(mass.radii_mm) };
        let depth = |p: &Vec3| inside.depth_mm(&(center + p.component_mul(&form.radii)));
        let least = sphere(MASS_SPLITS).points.iter().map(depth).fold(f64::INFINITY, f64::min);
        if least < 0.0 {
            return Err(PhantomError::MassOutside { number, center, beyond_mm: -least });
        }
        let reach = |form: &Ellipsoid| form.radii.max();
        let near = |(other, _): &(Ellipsoid, Material)| {
            (other.center - center).norm() < reach(other) + reach(&form)
        };
        if let Some(first) = all.iter().position(near) {
            return Err(PhantomError::MassesOverlap { first, second: number });
        }
        all.push((form, Material::named(&mass.material)?));
    }
    Ok(all)
}
