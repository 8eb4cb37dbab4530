//! Meshes and solutions in a group.

use super::{Hdf5Error, Reader, Writer};
use crate::{
    Vec3,
    labels::Tissue,
    mesh::{Patch, TetMesh},
    solution::{Checks, Solution},
    surface::TriMesh,
    units::NEWTON,
};
use std::collections::BTreeMap;

impl Writer {
    /// Writes a tetrahedral mesh: `points`, `tets`, `tissues`, `patches/NAME`.
    pub fn put_mesh(&mut self, group: &str, mesh: &TetMesh) -> Result<(), Hdf5Error> {
        self.put(&format!("{group}/points"), &mesh.points, "mm", "Node positions")?;
        self.put(&format!("{group}/tets"), &mesh.tets, "1", "Node indices of the tetrahedra")?;
        let tissues: Vec<u8> = mesh.tissues.iter().map(|tissue| tissue.label()).collect();
        self.put(&format!("{group}/tissues"), &tissues, "1", "Tissue label of each tetrahedron")?;
        self.group(&format!("{group}/patches"))?;
        for (patch, faces) in &mesh.patches {
            let name = format!("{group}/patches/{}", patch.name());
            self.put(&name, faces, "1", "Node indices of outer faces, outward")?;
        }
        Ok(())
    }

    /// Writes a surface: `points`, `triangles`.
    pub fn put_surface(&mut self, group: &str, surface: &TriMesh) -> Result<(), Hdf5Error> {
        self.put(&format!("{group}/points"), &surface.points, "mm", "Vertices")?;
        let name = format!("{group}/triangles");
        self.put(&name, &surface.triangles, "1", "Vertex indices of the triangles, outward")
    }

    /// Writes a solution: `points`, `mean_stress_kpa`, `deformation_gradient`, `cauchy_kpa`,
    /// `forces/{names,force_mn}`, `checks/..`. It comes back bit by bit.
    pub fn put_solution(&mut self, group: &str, solution: &Solution) -> Result<(), Hdf5Error> {
        let forces: Vec<Vec3> = solution.forces.values().copied().collect();
        self.put_equilibrium(group, solution)?;
        let name = format!("{group}/forces/force_mn");
        self.put(&name, &forces, "mN", "Total force of each term on the body")
    }

    /// Writes a solution for people: as [`put_solution`](Self::put_solution) does, but with forces
    /// in N (`forces/force_n`).
    pub fn put_state(&mut self, group: &str, solution: &Solution) -> Result<(), Hdf5Error> {
        let forces: Vec<Vec3> = solution.forces.values().map(|force| force / NEWTON).collect();
        self.put_equilibrium(group, solution)?;
        let name = format!("{group}/forces/force_n");
        self.put(&name, &forces, "N", "Total force of each term on the body")
    }

    /// All of a solution but the values of its forces.
    fn put_equilibrium(&mut self, group: &str, solution: &Solution) -> Result<(), Hdf5Error> {
        let at = |name: &str| format!("{group}/{name}");
        self.put(&at("points"), &solution.points, "mm", "Current node positions")?;
        let long_name = "Mean stress at the nodes, tr σ / 3: negative in compression";
        self.put(&at("mean_stress_kpa"), &solution.mean_stress_kpa, "kPa", long_name)?;
        let gradient = &solution.deformation_gradient;
        let long_name = "Deformation gradient of each tetrahedron";
        self.put(&at("deformation_gradient"), gradient, "1", long_name)?;
        let long_name = "Cauchy stress of each tetrahedron";
        self.put(&at("cauchy_kpa"), &solution.cauchy_kpa, "kPa", long_name)?;
        let names: Vec<&String> = solution.forces.keys().collect();
        self.put_texts(&at("forces/names"), &names, "Terms of the model")?;

        let checks = &solution.checks;
        let iterations = checks.iterations as u64;
        self.put_scalar(&at("checks/iterations"), iterations, "1", "Newton iterations")?;
        self.put_scalar(&at("checks/steps"), checks.steps as u64, "1", "Load steps")?;
        let long_name = "Largest unbalanced nodal force over the largest force of any term";
        self.put_scalar(&at("checks/residual"), checks.residual, "1", long_name)?;
        self.put_scalar(&at("checks/min_det_f"), checks.min_det_f, "1", "Smallest det F")?;
        let long_name = "Deepest penetration into a contact target";
        let deepest = checks.max_penetration_mm;
        self.put_scalar(&at("checks/max_penetration_mm"), deepest, "mm", long_name)?;
        let long_name = "Largest opening of a no-separation contact, or slip on a rough one";
        self.put_scalar(&at("checks/max_gap_mm"), checks.max_gap_mm, "mm", long_name)?;
        let long_name = "Norm of the sum of all forces over the largest of them";
        self.put_scalar(&at("checks/force_imbalance"), checks.force_imbalance, "1", long_name)?;
        let (long_name, turning) =
            ("Norm of the sum of all moments over the most of any term", checks.moment_imbalance);
        self.put_scalar(&at("checks/moment_imbalance"), turning, "1", long_name)?;
        let long_name =
            "Largest sum of forces or moments of a term within the body over the most of any term";
        let within = checks.internal_imbalance;
        self.put_scalar(&at("checks/internal_imbalance"), within, "1", long_name)?;
        let (long_name, lag) = ("Change of friction by one more round", checks.friction_lag);
        self.put_scalar(&at("checks/friction_lag"), lag, "1", long_name)
    }
}

impl Reader {
    /// Reads what [`Writer::put_mesh`] wrote; indices and tissues are checked.
    pub fn mesh(&self, group: &str) -> Result<TetMesh, Hdf5Error> {
        let points: Vec<Vec3> = self.get(&format!("{group}/points"))?;
        let tets: Vec<[u32; 4]> = self.get(&format!("{group}/tets"))?;
        self.check_indices(group, tets.as_flattened(), points.len())?;
        let labels: Vec<u8> = self.get(&format!("{group}/tissues"))?;
        if labels.len() != tets.len() {
            return Err(self.invalid(group, "tissues are not one for each tetrahedron"));
        }
        let tissue = |&label: &u8| {
            Tissue::from_label(label)
                .ok_or_else(|| self.invalid(group, format!("no tissue has label {label}")))
        };
        let tissues = labels.iter().map(tissue).collect::<Result<_, _>>()?;
        let mut patches = BTreeMap::new();
        for patch in Patch::ALL {
            let name = format!("{group}/patches/{}", patch.name());
            if self.has(&name) {
                let faces: Vec<[u32; 3]> = self.get(&name)?;
                self.check_indices(&name, faces.as_flattened(), points.len())?;
                patches.insert(patch, faces);
            }
        }
        Ok(TetMesh { points, tets, tissues, patches })
    }

    /// Reads what [`Writer::put_surface`] wrote; indices are checked.
    pub fn surface(&self, group: &str) -> Result<TriMesh, Hdf5Error> {
        let points: Vec<Vec3> = self.get(&format!("{group}/points"))?;
        let triangles: Vec<[u32; 3]> = self.get(&format!("{group}/triangles"))?;
        self.check_indices(group, triangles.as_flattened(), points.len())?;
        Ok(TriMesh { points, triangles })
    }

    /// Reads what [`Writer::put_solution`] wrote.
    pub fn solution(&self, group: &str) -> Result<Solution, Hdf5Error> {
        let at = |name: &str| format!("{group}/{name}");
        let names = self.texts(&at("forces/names"))?;
        let values: Vec<Vec3> = self.get(&at("forces/force_mn"))?;
        if names.len() != values.len() {
            return Err(self.invalid(group, "forces are not one for each name"));
        }
        let checks = Checks {
            iterations: self.scalar::<u64>(&at("checks/iterations"))? as usize,
            steps: self.scalar::<u64>(&at("checks/steps"))? as usize,
            residual: self.scalar(&at("checks/residual"))?,
            min_det_f: self.scalar(&at("checks/min_det_f"))?,
            max_penetration_mm: self.scalar(&at("checks/max_penetration_mm"))?,
            max_gap_mm: self.scalar(&at("checks/max_gap_mm"))?,
            force_imbalance: self.scalar(&at("checks/force_imbalance"))?,
            moment_imbalance: self.scalar(&at("checks/moment_imbalance"))?,
            internal_imbalance: self.scalar(&at("checks/internal_imbalance"))?,
            friction_lag: self.scalar(&at("checks/friction_lag"))?,
        };
        Ok(Solution {
            points: self.get(&at("points"))?,
            mean_stress_kpa: self.get(&at("mean_stress_kpa"))?,
            deformation_gradient: self.get(&at("deformation_gradient"))?,
            cauchy_kpa: self.get(&at("cauchy_kpa"))?,
            forces: names.into_iter().zip(values).collect(),
            checks,
        })
    }

    fn check_indices(&self, name: &str, indices: &[u32], nodes: usize) -> Result<(), Hdf5Error> {
        match indices.iter().find(|&&index| index as usize >= nodes) {
            Some(index) => Err(self.invalid(name, format!("node {index} of {nodes}"))),
            None => Ok(()),
        }
    }
}
