//! What photons fly through: homogeneous boxes and one breast, in air.

use crate::xray::transport::media::{MAX_MEDIA, Media};
use mammotwin_data::Vec3;
use rayon::prelude::*;

/// Photons closer than this (mm) to the far side of a box have left it.
const TOUCH_MM: f64 = 1e-7;

/// Multiples of the three fill the unit cube evenly (powers of 1/g with g⁴ = g + 1).
const SPREAD: [f64; 3] = [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9];

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
    #[inline]
    pub fn contains(&self, p: &Vec3) -> bool {
        (0..3).all(|k| self.low[k] <= p[k] && p[k] <= self.high[k])
    }

    /// Distances (mm) at which a ray enters and leaves; the first is larger when it misses.
    #[inline]
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

    /// Radius (mm) around a point in which there is nothing but air.
    fn clear_mm(&self, _: &Vec3) -> f64 {
        0.0
    }
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
    /// More materials than there is room for.
    #[error("{0} materials; a scene has at most {MAX_MEDIA}")]
    TooMany(usize),
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
        if count > MAX_MEDIA {
            return Err(SceneError::TooMany(count));
        }
        if let Some(medium) = all.chain(body.media().iter().copied()).find(|&m| m >= count) {
            return Err(SceneError::Medium { medium, count });
        }
        let media_of = [air].into_iter().chain(blocks.iter().map(|block| block.medium)).collect();
        Ok(Self { media, air, world, body, boxes, media_of })
    }

    #[inline]
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
}

/// Volume (mm³) of each material in the body where `counts` holds, by one point in each cell
/// of a grid. It lies elsewhere in each cell, so that no side of the body is missed or met by
/// a whole layer at once.
pub fn volumes_mm3<B: Body>(
    body: &B,
    step_mm: f64,
    counts: impl Fn(&Vec3) -> bool + Sync,
) -> Vec<f64> {
    let bounds = body.bounds();
    let size = bounds.high - bounds.low;
    let count = [0, 1, 2].map(|k| (size[k] / step_mm).ceil().max(1.0) as usize);
    let step = Vec3::from_fn(|k, _| size[k] / count[k] as f64);
    let row = |j: usize| {
        let mut found = [0u64; MAX_MEDIA];
        for i in 0..count[0] {
            for k in 0..count[2] {
                let number = ((j * count[0] + i) * count[2] + k) as f64;
                let cell = [i, j, k];
                let at = |a: usize| cell[a] as f64 + (SPREAD[a] * number).fract();
                let point = bounds.low + Vec3::from_fn(|a, _| at(a) * step[a]);
                if counts(&point) {
                    found[body.medium(&point)] += 1;
                }
            }
        }
        found
    };
    let add = |mut a: [u64; MAX_MEDIA], b: [u64; MAX_MEDIA]| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    let found = (0..count[1]).into_par_iter().map(row).reduce(|| [0; MAX_MEDIA], add);
    found.iter().map(|&n| n as f64 * step.x * step.y * step.z).collect()
}
