//! Loads that only tests need.

use mammotwin_data::Vec3;
use mammotwin_solver::materials::MaterialError;
use mammotwin_solver::mesh::quadratic::FACE_EDGES;
use mammotwin_solver::terms::{At, Block, Load, Order, Term};

/// Forces that keep their direction.
pub struct DeadForces {
    nodes: Vec<u32>,
    forces: Vec<Vec3>,
}

impl DeadForces {
    /// Forces (mN) on nodes.
    pub fn new(forces: impl IntoIterator<Item = (u32, Vec3)>) -> Self {
        let (nodes, forces) = forces.into_iter().unzip();
        Self { nodes, forces }
    }
}

impl Term for DeadForces {
    fn name(&self) -> &str {
        "forces"
    }

    fn elements(&self) -> usize {
        self.nodes.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.nodes[element..=element]
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let force = at.load.gravity * self.forces[element];
        block.energy = -force.dot(&at.points[self.nodes[element] as usize]);
        if order >= Order::Gradient {
            block.gradient[0] = -force;
        }
        Ok(())
    }
}

/// Pressure in a cavity around the origin, of which `faces` are a part, pointing out of it: the
/// energy is minus the pressure times the volume between the faces and the origin.
pub struct Cavity {
    pub faces: Vec<[u32; 3]>,
    pub pressure_kpa: f64,
}

impl Term for Cavity {
    fn name(&self) -> &str {
        "cavity"
    }

    fn elements(&self) -> usize {
        self.faces.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.faces[element]
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let [a, b, c] = self.faces[element].map(|n| at.points[n as usize]);
        let p = at.load.gravity * self.pressure_kpa / 6.0;
        block.energy = -p * a.dot(&b.cross(&c));
        if order >= Order::Gradient {
            block.gradient[..3].copy_from_slice(&[
                -p * b.cross(&c),
                -p * c.cross(&a),
                -p * a.cross(&b),
            ]);
        }
        if order >= Order::Hessian {
            // d(a × b) = a × db - b × da.
            block.hessian[1][0] = -p * c.cross_matrix();
            block.hessian[2][0] = p * b.cross_matrix();
            block.hessian[2][1] = -p * a.cross_matrix();
        }
        Ok(())
    }
}

/// The same on six-node faces, which may be curved.
pub struct CurvedCavity {
    pub faces: Vec<[u32; 6]>,
    pub pressure_kpa: f64,
}

/// Weight (of an area of ½), values and slopes of the six shape functions at the points of a rule for functions of
/// fourth order (Strang & Fix 1973).
fn six_node_points() -> impl Iterator<Item = (f64, [f64; 6], [[f64; 2]; 6])> {
    let rings = [
        (0.109_951_743_655_321_85, 0.091_576_213_509_770_74),
        (0.223_381_589_678_011_46, 0.445_948_490_915_964_9),
    ];
    rings.into_iter().flat_map(|(weight, b)| {
        (0..3).map(move |corner| {
            let mut l = [b; 3];
            l[corner] = 1.0 - 2.0 * b;
            let (mut values, mut slopes) = ([0.0; 6], [[0.0; 2]; 6]);
            for n in 0..6 {
                let mut by = [0.0; 3];
                if n < 3 {
                    values[n] = l[n] * (2.0 * l[n] - 1.0);
                    by[n] = 4.0 * l[n] - 1.0;
                } else {
                    let [a, c] = FACE_EDGES[n - 3];
                    values[n] = 4.0 * l[a] * l[c];
                    (by[a], by[c]) = (4.0 * l[c], 4.0 * l[a]);
                }
                slopes[n] = [by[1] - by[0], by[2] - by[0]];
            }
            (0.5 * weight, values, slopes)
        })
    })
}

impl Term for CurvedCavity {
    fn name(&self) -> &str {
        "cavity"
    }

    fn elements(&self) -> usize {
        self.faces.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.faces[element]
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let nodes = self.faces[element].map(|n| at.points[n as usize]);
        let pressure = at.load.gravity * self.pressure_kpa / 3.0;
        for (weight, values, slopes) in six_node_points() {
            let p = weight * pressure;
            let sum = |part: &dyn Fn(usize) -> f64| -> Vec3 {
                nodes.iter().enumerate().map(|(n, x)| part(n) * x).sum()
            };
            let (x, t, s) = (sum(&|n| values[n]), sum(&|n| slopes[n][0]), sum(&|n| slopes[n][1]));
            // Minus p x · (t × s), of which each factor is linear in the nodes.
            block.energy -= p * x.dot(&t.cross(&s));
            if order >= Order::Gradient {
                for (n, gradient) in block.gradient[..6].iter_mut().enumerate() {
                    let [by_t, by_s] = slopes[n];
                    *gradient -=
                        p * (values[n] * t.cross(&s) + by_t * s.cross(&x) + by_s * x.cross(&t));
                }
            }
            if order >= Order::Hessian {
                let (x, t, s) = (x.cross_matrix(), t.cross_matrix(), s.cross_matrix());
                for a in 0..6 {
                    for b in 0..=a {
                        let ([at, as_], [bt, bs]) = (slopes[a], slopes[b]);
                        let (av, bv) = (values[a], values[b]);
                        block.hessian[a][b] -= p
                            * ((av * bs - as_ * bv) * t
                                + (at * bv - av * bt) * s
                                + (as_ * bt - at * bs) * x);
                    }
                }
            }
        }
        Ok(())
    }
}

/// Forces that keep their direction and grow with the place of the receptor: full at 1 mm.
pub struct Pull(pub DeadForces);

impl Term for Pull {
    fn name(&self) -> &str {
        "pull"
    }

    fn elements(&self) -> usize {
        self.0.elements()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        self.0.nodes(element)
    }

    fn block(
        &self,
        element: usize,
        at: &At,
        order: Order,
        block: &mut Block,
    ) -> Result<(), MaterialError> {
        let load = Load { gravity: at.load.receptor_mm, ..at.load };
        self.0.block(element, &At { load, ..*at }, order, block)
    }
}
