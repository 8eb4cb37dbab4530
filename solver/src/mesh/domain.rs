//! The body to be meshed, as signed distances to the surfaces that bound it.

use mammotwin_data::{Mat3, Vec3, mesh::Patch};

/// A body bounded by up to seven surfaces: where all signed distances are negative.
pub trait Domain: Sync {
    /// Signed distances (mm, negative inside) from `p` to the surfaces that bound the body. The same
    /// patches at every point, smooth near their zero, and of slope about one.
    fn distances(&self, p: &Vec3) -> PatchDistances;

    /// Corners (mm) of a box along the axes that holds the body.
    fn bounds(&self) -> (Vec3, Vec3);

    /// One of the [`distances`](Domain::distances): for bodies that know it without the others.
    fn distance(&self, p: &Vec3, patch: Patch) -> f64 {
        self.distances(p).of(patch)
    }

    /// Gradient of the [`distance`](Domain::distance) to a patch: for bodies that know it without
    /// differences.
    fn gradient(&self, p: &Vec3, patch: Patch) -> Vec3 {
        difference_gradient(self, p, patch)
    }
}

/// Gradient of the distance to a patch by central differences.
pub fn difference_gradient(domain: &(impl Domain + ?Sized), p: &Vec3, patch: Patch) -> Vec3 {
    const STEP_MM: f64 = 0.02;
    Vec3::from_fn(|axis, _| {
        let mut step = Vec3::zeros();
        step[axis] = STEP_MM;
        let (above, below) =
            (domain.distance(&(p + step), patch), domain.distance(&(p - step), patch));
        (above - below) / (2.0 * STEP_MM)
    })
}

/// One signed distance (mm) for each patch that bounds the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchDistances([f64; Patch::ALL.len()]);

impl PatchDistances {
    /// No patch yet: all of space.
    pub fn none() -> Self {
        Self([f64::NEG_INFINITY; Patch::ALL.len()])
    }

    /// Adds a bounding surface.
    pub fn with(mut self, patch: Patch, distance_mm: f64) -> Self {
        self.0[patch as usize] = distance_mm;
        self
    }

    /// Distance to a patch; minus infinity when the body has no such patch.
    pub fn of(&self, patch: Patch) -> f64 {
        self.0[patch as usize]
    }

    /// Signed distance to the body as a whole: the largest.
    pub fn max(&self) -> f64 {
        self.0.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Patches that bound the body.
    pub fn patches(&self) -> impl Iterator<Item = Patch> + '_ {
        Patch::ALL.into_iter().filter(|&patch| self.of(patch) > f64::NEG_INFINITY)
    }
}

/// A set of patches: the surfaces that a node lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PatchSet(u8);

impl PatchSet {
    /// No patch: a node inside the body.
    pub const NONE: Self = Self(0);

    /// The set with one more patch.
    pub fn with(self, patch: Patch) -> Self {
        Self(self.0 | 1 << patch as u8)
    }

    /// Patches in both.
    pub fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Whether `patch` is in the set.
    pub fn has(self, patch: Patch) -> bool {
        self.0 >> patch as u8 & 1 == 1
    }

    /// Whether all patches of the set are in `other`.
    pub fn within(self, other: Self) -> bool {
        self.0 & !other.0 == 0
    }

    /// Number of patches.
    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether it holds no patch.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The patches, in order.
    pub fn iter(self) -> impl Iterator<Item = Patch> {
        Patch::ALL.into_iter().filter(move |&patch| self.has(patch))
    }
}

/// Nearness (mm) to a surface at which a node counts as lying on it.
pub const ON_SURFACE_MM: f64 = 0.01;

/// The point near `p` that lies on all surfaces of `set`, by Newton's method with the shortest step.
///
/// `None` when there is none within `reach_mm`, or when more than three surfaces are asked for.
pub fn project(domain: &dyn Domain, p: &Vec3, set: PatchSet, reach_mm: f64) -> Option<Vec3> {
    if set.len() > 3 {
        return None;
    }
    let patches: Vec<Patch> = set.iter().collect();
    let patches = &patches[..];
    let mut at = *p;
    for _ in 0..12 {
        let here: Vec<f64> = patches.iter().map(|&patch| domain.distance(&at, patch)).collect();
        if here.iter().all(|distance| distance.abs() < 0.1 * ON_SURFACE_MM) {
            return Some(at);
        }
        at -= shortest_step(domain, &at, patches, &here)?;
        if (at - p).norm() > reach_mm {
            return None;
        }
    }
    let on = |&patch: &Patch| domain.distance(&at, patch).abs() < ON_SURFACE_MM;
    patches.iter().all(on).then_some(at)
}

/// Solves `G step = f` for the step of least length, `G` the gradients of the distances `f`.
fn shortest_step(domain: &dyn Domain, at: &Vec3, patches: &[Patch], here: &[f64]) -> Option<Vec3> {
    let gradients: Vec<Vec3> = patches.iter().map(|&patch| domain.gradient(at, patch)).collect();
    // Gram matrix, padded with the identity where there are fewer than three surfaces.
    let mut gram = Mat3::identity();
    let mut value = Vec3::zeros();
    for r in 0..patches.len() {
        value[r] = here[r];
        for c in 0..patches.len() {
            gram[(r, c)] = gradients[r].dot(&gradients[c]);
        }
    }
    // Surfaces that are nearly tangent to each other have no crease worth a step.
    if gram.determinant() < 1e-2 {
        return None;
    }
    let weight = gram.try_inverse()? * value;
    Some((0..patches.len()).map(|r| weight[r] * gradients[r]).sum())
}
