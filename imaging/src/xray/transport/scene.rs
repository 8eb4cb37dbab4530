//! What photons fly through: homogeneous boxes and one breast, in air.

use crate::xray::transport::media::Media;
use mammotwin_data::Vec3;

/// Photons closer than this (mm) to the far side of a box have left it.
const TOUCH_MM: f64 = 1e-7;

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates (mm).
    pub low: Vec3,
    /// Largest coordinates (mm).
    pub high: Vec3,
}

impl Bounds {
    /// A box of these ranges (mm) along x, y, z.
    pub fn of(x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> Self {
        Self { low: Vec3::new(x[0], y[0], z[0]), high: Vec3::new(x[1], y[1], z[1]) }
    }

    /// Whether a point lies in the box.
    pub fn contains(&self, p: &Vec3) -> bool {
        (0..3).all(|k| self.low[k] <= p[k] && p[k] <= self.high[k])
    }

    /// Distances (mm) at which a ray enters and leaves; the first is larger when it misses.
    pub fn cross(&self, from: &Vec3, inverse: &Vec3) -> [f64; 2] {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for k in 0..3 {
            let a = (self.low[k] - from[k]) * inverse[k];
            let b = (self.high[k] - from[k]) * inverse[k];
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        [enter, leave]
    }

    fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|k| {
            self.low[k] + TOUCH_MM < other.high[k] && other.low[k] + TOUCH_MM < self.high[k]
        })
    }
}

/// A box of one material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Where.
    pub bounds: Bounds,
    /// Index of its material.
    pub medium: usize,
}

/// Something with several materials inside of a box.
pub trait Body: Sync {
    /// The box around it.
    fn bounds(&self) -> Bounds;

    /// Materials that may be met in the box.
    fn media(&self) -> &[usize];

    /// Material at a point of the box.
    fn medium(&self, point: &Vec3) -> usize;
}

/// Why a scene is none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// Two boxes share a volume.
    #[error("{first:?} and {second:?} overlap; photons would not know where they are")]
    Overlap {
        /// One box.
        first: Bounds,
        /// Another.
        second: Bounds,
    },
    /// An index without a material.
    #[error("medium {medium} of {count} is not there")]
    Medium {
        /// Index.
        medium: usize,
        /// Number of materials.
        count: usize,
    },
}

/// Air, boxes and a body in it.
#[derive(Debug, Clone)]
pub struct Scene<B> {
    /// Materials.
    pub media: Media,
    /// Index of what fills the world between boxes.
    pub air: usize,
    /// Where photons are followed.
    pub world: Bounds,
    /// The body.
    pub body: B,
    /// Index 0 is the body's.
    boxes: Vec<Bounds>,
    media_of: Vec<usize>,
}

/// What a ray meets next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ahead {
    /// Distance (mm) to its entry; not positive inside of it.
    pub entry: f64,
    /// Distance (mm) to its exit.
    pub exit: f64,
    /// `None`: the end of the world.
    pub place: Option<Place>,
}

/// Kind of a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Place {
    Body,
    Block(usize),
}

impl<B: Body> Scene<B> {
    /// Puts a body and blocks into air; they may touch, not overlap.
    pub fn new(
        media: Media,
        air: usize,
        world: Bounds,
        body: B,
        blocks: &[Block],
    ) -> Result<Self, SceneError> {
        let mut boxes = vec![body.bounds()];
        boxes.extend(blocks.iter().map(|block| block.bounds));
        for (n, &first) in boxes.iter().enumerate() {
            if let Some(&second) = boxes[n + 1..].iter().find(|other| first.overlaps(other)) {
                return Err(SceneError::Overlap { first, second });
            }
        }
        let count = media.materials().len();
        let all = blocks.iter().map(|block| block.medium).chain([air]);
        if let Some(medium) = all.chain(body.media().iter().copied()).find(|&m| m >= count) {
            return Err(SceneError::Medium { medium, count });
        }
        let media_of = [air].into_iter().chain(blocks.iter().map(|block| block.medium)).collect();
        Ok(Self { media, air, world, body, boxes, media_of })
    }

    pub(crate) fn ahead(&self, from: &Vec3, inverse: &Vec3) -> Ahead {
        let end = self.world.cross(from, inverse)[1];
        let mut ahead = Ahead { entry: end, exit: end, place: None };
        for (n, bounds) in self.boxes.iter().enumerate() {
            let [entry, exit] = bounds.cross(from, inverse);
            if exit > entry.max(TOUCH_MM) && entry < ahead.entry {
                let place = if n == 0 { Place::Body } else { Place::Block(self.media_of[n]) };
                ahead = Ahead { entry, exit, place: Some(place) };
            }
        }
        ahead
    }

    /// Volume (mm³) of each material in the body where `counts` holds, by a lattice of points.
    pub fn volumes_mm3(&self, step_mm: f64, counts: impl Fn(&Vec3) -> bool) -> Vec<f64> {
        let bounds = self.body.bounds();
        let steps = [0, 1, 2].map(|k| {
            let length = bounds.high[k] - bounds.low[k];
            let count = (length / step_mm).ceil().max(1.0);
            (count as usize, length / count)
        });
        let place = |k: usize, n: usize| bounds.low[k] + (n as f64 + 0.5) * steps[k].1;
        let mut found = vec![0u64; self.media.materials().len()];
        for k in 0..steps[2].0 {
            for j in 0..steps[1].0 {
                for i in 0..steps[0].0 {
                    let point = Vec3::new(place(0, i), place(1, j), place(2, k));
                    if counts(&point) {
                        found[self.body.medium(&point)] += 1;
                    }
                }
            }
        }
        let cell = steps[0].1 * steps[1].1 * steps[2].1;
        found.iter().map(|&n| n as f64 * cell).collect()
    }
}
