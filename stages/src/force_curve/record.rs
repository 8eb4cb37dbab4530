//! What was measured of a compression, and how surely.

use serde::{Deserialize, Serialize};

/// A quantity that a unit, an image or an inclinometer gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Force of the paddle (N).
    Force,
    /// Contact area of the paddle (mm²).
    Area,
    /// How far the breast reaches beyond the chest-wall edge of the plates (mm).
    Extent,
    /// Tilt of the paddle (degrees).
    Tilt,
}

impl Channel {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Force, Self::Area, Self::Extent, Self::Tilt];

    /// Column of a record.
    pub fn column(self) -> &'static str {
        match self {
            Self::Force => "force_n",
            Self::Area => "contact_area_mm2",
            Self::Extent => "extent_mm",
            Self::Tilt => "tilt_deg",
        }
    }

    /// Place among all.
    pub fn place(self) -> usize {
        self as usize
    }
}

/// One measured value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Distance of the plates (mm), as the unit shows it.
    pub thickness_mm: f64,
    /// What was measured.
    pub channel: Channel,
    /// Its value.
    pub value: f64,
}

/// Sizes of errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RecordError {
    /// Of a force in proportion, point by point.
    pub force_part: f64,
    /// Of a force (N), point by point.
    pub force_n: f64,
    /// Of all forces of a record alike (gain), in proportion.
    pub gain: f64,
    /// Of all thicknesses of a record alike (mm).
    pub thickness_mm: f64,
    /// Of a contact area in proportion.
    pub area_part: f64,
    /// Of the extent of the breast (mm): posture, edge of the image.
    pub extent_mm: f64,
    /// Of a tilt (degrees).
    pub tilt_deg: f64,
    /// Of the stiffness that a calibration under gravity finds, in proportion.
    pub stiffness: f64,
}

impl Default for RecordError {
    /// Forces and thicknesses as elsewhere in `discover`; area, extent and tilt are assumptions; the
    /// stiffness is that of `study calibration`: within 12 % in 12 of 12 breasts.
    fn default() -> Self {
        Self {
            force_part: 0.03,
            force_n: 0.5,
            gain: 0.03,
            thickness_mm: 1.0,
            area_part: 0.05,
            extent_mm: 1.5,
            tilt_deg: 0.3,
            stiffness: 0.1,
        }
    }
}

impl RecordError {
    /// Standard deviation of a value, without what all values of a record have in common.
    pub fn of(&self, channel: Channel, value: f64) -> f64 {
        match channel {
            Channel::Force => (self.force_part * value).hypot(self.force_n),
            // Where nothing is touched, a few square centimetres may go unseen.
            Channel::Area => (self.area_part * value).hypot(200.0),
            Channel::Extent => self.extent_mm,
            Channel::Tilt => self.tilt_deg,
        }
    }
}

/// A record: readings, those at large thicknesses first.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Record(pub Vec<Reading>);

/// Part of the forces, those at the smallest thicknesses, that the search does not see.
const HELD_OUT: f64 = 0.25;
/// Fewest forces that are held out.
const FEWEST_HELD_OUT: usize = 2;

impl Record {
    /// Sorts readings.
    pub fn new(mut readings: Vec<Reading>) -> Self {
        readings.sort_by(|a, b| {
            b.thickness_mm.total_cmp(&a.thickness_mm).then(a.channel.cmp(&b.channel))
        });
        Self(readings)
    }

    /// Number of forces.
    pub fn forces(&self) -> usize {
        self.0.iter().filter(|r| r.channel == Channel::Force).count()
    }

    /// Places of the readings that the search sees, and of the last forces, which decide.
    pub fn split(&self) -> [Vec<usize>; 2] {
        let forces = self.forces();
        let decide = ((HELD_OUT * forces as f64).round() as usize).max(FEWEST_HELD_OUT).min(forces);
        let mut seen_forces = forces - decide;
        let (mut seen, mut held_out) = (Vec::new(), Vec::new());
        for (n, reading) in self.0.iter().enumerate() {
            if reading.channel != Channel::Force {
                seen.push(n);
            } else if seen_forces > 0 {
                seen_forces -= 1;
                seen.push(n);
            } else {
                held_out.push(n);
            }
        }
        [seen, held_out]
    }

    /// Some of the readings.
    pub fn rows(&self, rows: &[usize]) -> Self {
        Self(rows.iter().map(|&n| self.0[n]).collect())
    }

    /// Only some of the quantities.
    pub fn only(&self, channels: &[Channel]) -> Self {
        Self(self.0.iter().filter(|r| channels.contains(&r.channel)).copied().collect())
    }

    /// Smallest thickness (mm).
    pub fn thinnest_mm(&self) -> f64 {
        self.0.iter().map(|r| r.thickness_mm).fold(f64::INFINITY, f64::min)
    }

    /// Largest force (N).
    pub fn largest_force_n(&self) -> f64 {
        let forces = self.0.iter().filter(|r| r.channel == Channel::Force);
        forces.map(|r| r.value).fold(0.0, f64::max)
    }
}
