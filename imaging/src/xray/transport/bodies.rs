//! Breasts to fly through: the half cylinder of benchmarks and closed surfaces.

use crate::xray::{
    raster::RasterError,
    shapes::Ellipsoid,
    transport::{
        distance::{DistanceGrid, Zone},
        scene::{Body, Bounds},
    },
};
use mammotwin_data::{Vec3, surface::TriMesh};

/// Half of an upright cylinder with a layer of skin (none at the chest wall), between two heights
/// that may differ from the chest wall to the front.
///
/// Frame of the detector: the chest wall is the plane y = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct HalfCylinder {
    /// Outer radius (mm).
    pub radius: f64,
    /// Height (mm) of the lower side.
    pub bottom: f64,
    /// Height (mm) of the upper side above the chest wall.
    pub top: f64,
    /// How much (mm) the upper side sinks for each mm away from the chest wall: a flexible paddle.
    pub slope: f64,
    /// Skin (mm).
    pub skin: f64,
    /// Air, skin, tissue.
    pub media: [usize; 3],
}

impl HalfCylinder {
    /// Height (mm) of the upper side.
    #[inline]
    pub fn top_at(&self, y: f64) -> f64 {
        self.top - self.slope * y
    }
}

impl Body for HalfCylinder {
    fn bounds(&self) -> Bounds {
        let r = self.radius;
        Bounds::of([-r, r], [0.0, r], [self.bottom, self.top.max(self.top_at(r))])
    }

    #[inline]
    fn media(&self) -> &[usize] {
        &self.media
    }

    #[inline]
    fn medium(&self, p: &Vec3) -> usize {
        let r2 = p.x * p.x + p.y * p.y;
        // Measured along z: for the slopes of paddles (5°) the skin is 0.4 % thinner.
        let depth = self.top_at(p.y) - p.z;
        let inner = self.radius - self.skin;
        if r2 > self.radius * self.radius || depth < 0.0 || p.y < 0.0 {
            self.media[0]
        } else if r2 > inner * inner || depth < self.skin || p.z < self.bottom + self.skin {
            self.media[1]
        } else {
            self.media[2]
        }
    }

    #[inline]
    fn clear_mm(&self, p: &Vec3) -> f64 {
        (p.x.hypot(p.y) - self.radius).max(0.0)
    }
}

/// A closed surface with a layer of skin below it, and inclusions in the tissue.
#[derive(Debug, Clone)]
pub struct Closed {
    distance: DistanceGrid,
    /// Air, skin, tissue, and what the inclusions are made of.
    media: Vec<usize>,
    /// Gland by its distances.
    gland: Option<(DistanceGrid, usize)>,
    masses: Vec<(Ellipsoid, usize)>,
}

/// What the distance between nodes may be off by (mm).
const SURE_MM: f64 = 0.5;

impl Closed {
    /// A compressed breast. Its surface is known by distances on a grid of this step (mm).
    pub fn new(
        surface: &TriMesh,
        step_mm: f64,
        skin_mm: f64,
        media: [usize; 3],
    ) -> Result<Self, RasterError> {
        Ok(Self::of(DistanceGrid::of(surface, None, step_mm, skin_mm)?, media))
    }

    /// The part of a surface that lies in a box: a breast without the body behind it, whose end has
    /// no skin.
    pub fn part(
        surface: &TriMesh,
        part: Bounds,
        step_mm: f64,
        skin_mm: f64,
        media: [usize; 3],
    ) -> Result<Self, RasterError> {
        Ok(Self::of(DistanceGrid::of(surface, Some(part), step_mm, skin_mm)?, media))
    }

    fn of(distance: DistanceGrid, media: [usize; 3]) -> Self {
        Self { distance, media: media.to_vec(), gland: None, masses: Vec::new() }
    }

    /// With gland in a closed surface, known by distances on a grid of this step (mm); nothing of it lies in
    /// the skin.
    pub fn with_gland(
        mut self,
        surface: &TriMesh,
        step_mm: f64,
        medium: usize,
    ) -> Result<Self, RasterError> {
        let part = self.distance.bounds();
        self.gland = Some((DistanceGrid::of(surface, Some(part), step_mm, 0.0)?, medium));
        self.also(medium);
        Ok(self)
    }

    /// With an ellipsoid of another material, which may replace gland.
    pub fn with_mass(mut self, form: Ellipsoid, medium: usize) -> Self {
        self.masses.push((form, medium));
        self.also(medium);
        self
    }

    fn also(&mut self, medium: usize) {
        if !self.media.contains(&medium) {
            self.media.push(medium);
        }
    }

    /// Medium of a point below the skin.
    #[inline]
    fn deep(&self, point: &Vec3) -> usize {
        if let Some((_, medium)) = self.masses.iter().find(|(form, _)| form.contains(point)) {
            return *medium;
        }
        match &self.gland {
            Some((grid, medium))
                if grid.bounds().contains(point) && grid.zone(point) != Zone::Outside =>
            {
                *medium
            }
            _ => self.media[2],
        }
    }
}

impl Body for Closed {
    fn bounds(&self) -> Bounds {
        self.distance.bounds()
    }

    #[inline]
    fn media(&self) -> &[usize] {
        &self.media
    }

    #[inline]
    fn medium(&self, point: &Vec3) -> usize {
        match self.distance.zone(point) {
            Zone::Outside => self.media[0],
            Zone::Layer => self.media[1],
            Zone::Deep => self.deep(point),
        }
    }

    #[inline]
    fn clear_mm(&self, point: &Vec3) -> f64 {
        (self.distance.outside(point) - SURE_MM).max(0.0)
    }
}
