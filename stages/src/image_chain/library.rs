//! Effects that an image model may lack.

/// What the image model has beside primary photons of one energy, published blur and Dance's dose. All
/// zero: nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Chain {
    /// Scattered photons behind a grid, over those that Monte Carlo finds.
    pub scatter: f64,
    /// Loss of photons per 100 mm away from the chest wall.
    pub heel: f64,
    /// Share of photons that come with the tube's spectrum instead of one energy.
    pub beam_spectrum: f64,
    /// Standard deviation (mm) of a further blur.
    pub blur: f64,
    /// Change of dose per largest less smallest thickness over their mean.
    pub agd_wedge: f64,
}

/// An effect of the image chain: a sentence and how it changes the image model.
pub struct ImageEffect {
    /// Its word.
    pub name: &'static str,
    /// What it is.
    pub sentence: &'static str,
    /// What its amplitude says.
    pub meaning: &'static str,
    /// Unit of its amplitude.
    pub unit: &'static str,
    /// Plausible range; holds zero, the model without it.
    pub range: [f64; 2],
    /// An amplitude for differences.
    pub small: f64,
    /// What tells it from others.
    pub signature: &'static str,
    /// Where its amplitude is.
    pub of: fn(&mut Chain) -> &mut f64,
}

/// The library.
pub static IMAGE_EFFECTS: [ImageEffect; 5] = [
    ImageEffect {
        name: "scatter",
        sentence: "Scattered photons reach the detector behind the grid.",
        meaning: "scatter over that of Monte Carlo in the same body",
        unit: "1",
        range: [0.0, 3.0],
        small: 0.05,
        signature: "more signal where the breast is thick, less at its rim; smooth",
        of: |chain| &mut chain.scatter,
    },
    ImageEffect {
        name: "heel",
        sentence: "The anode takes photons away on the side that it faces.",
        meaning: "loss per 100 mm away from the chest wall",
        unit: "1",
        range: [-0.3, 0.3],
        small: 0.005,
        signature: "a gradient from the chest wall to the nipple, in the flat field as well",
        of: |chain| &mut chain.heel,
    },
    ImageEffect {
        name: "beam_spectrum",
        sentence: "The tube gives a spectrum, not one energy: thick parts let more through.",
        meaning: "share of photons with the spectrum of 34 kV Rh/Ag",
        unit: "1",
        range: [0.0, 1.2],
        small: 0.02,
        signature: "logarithmic signal is bent over path length",
        of: |chain| &mut chain.beam_spectrum,
    },
    ImageEffect {
        name: "blur",
        sentence: "The picture is less sharp than the detector's published curve.",
        meaning: "standard deviation of a further Gaussian",
        unit: "mm",
        range: [0.0, 0.25],
        small: 0.04,
        signature: "grains are fainter and wider; nothing in smooth parts",
        of: |chain| &mut chain.blur,
    },
    ImageEffect {
        name: "agd_wedge",
        sentence: "Under a tilted paddle the dose is not that of a flat one of the mean thickness.",
        meaning: "change of dose per relative wedge",
        unit: "1",
        range: [-0.6, 0.6],
        small: 0.01,
        signature: "doses under tilted paddles alone",
        of: |chain| &mut chain.agd_wedge,
    },
];

impl ImageEffect {
    /// The effect of a word.
    pub fn named(name: &str) -> Option<&'static Self> {
        IMAGE_EFFECTS.iter().find(|effect| effect.name == name)
    }
}
