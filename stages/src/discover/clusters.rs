//! Where residuals are larger than errors leave: clusters of nodes, named by anatomy.

use super::{
    evidence::Evidence,
    observe::{leftover, part},
    verdict::Judge,
};
use crate::model::Anatomy;
use mammotwin_data::Vec3;
use mammotwin_imaging::xray::statistics::two_sided;
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// Neighbouring nodes of one pose whose residuals have one sign and are no noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cluster {
    /// The pose.
    pub pose: String,
    /// Where its middle lies: `right breast, lower outer quadrant`.
    pub place: String,
    /// Places among the compared nodes.
    pub nodes: Vec<usize>,
    /// Mean residual (mm) after the best rigid motion; positive: simulated outside of measured.
    pub mean_mm: f64,
    /// Largest residual over what errors leave there.
    pub largest_z: f64,
}

/// Part of false ones among the nodes that are called significant (Benjamini & Hochberg 1995).
const FALSE_DISCOVERIES: f64 = 0.05;
/// Fewer nodes are no cluster.
const FEWEST: usize = 3;

/// Clusters of residuals (mm, all poses) that errors do not explain, the largest first.
pub(super) fn clusters(
    judge: &Judge,
    evidence: &Evidence,
    anatomy: &Anatomy,
    residual: &DVector<f64>,
) -> Vec<Cluster> {
    let nodes = evidence.nodes();
    let mut all = Vec::new();
    for (p, pose) in evidence.poses.iter().enumerate() {
        let own = part(residual, &[p], nodes);
        let left = &own - evidence.shapes[p].rigid_part(&own);
        let errors = leftover(&judge.covariance_of(p), &judge.fitted(p));
        let z: Vec<f64> = (0..nodes).map(|n| left[n] / errors[(n, n)].sqrt()).collect();
        let limit = threshold(&z);
        for cluster in joined(&evidence.edges, &z, limit) {
            let middle = cluster.iter().map(|&n| evidence.reference.points[n]).sum::<Vec3>()
                / cluster.len() as f64;
            all.push(Cluster {
                pose: pose.clone(),
                place: place(anatomy, &middle),
                mean_mm: cluster.iter().map(|&n| left[n]).sum::<f64>() / cluster.len() as f64,
                largest_z: cluster.iter().map(|&n| z[n].abs()).fold(0.0, f64::max),
                nodes: cluster,
            });
        }
    }
    all.sort_by_key(|cluster| std::cmp::Reverse(cluster.nodes.len()));
    all
}

/// The score beyond which nodes are significant; infinite when none is.
fn threshold(z: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = z.iter().map(|z| z.abs()).filter(|z| z.is_finite()).collect();
    sizes.sort_by(|a, b| b.total_cmp(a));
    let count = sizes.len() as f64;
    let allowed = |rank: usize| FALSE_DISCOVERIES * (rank + 1) as f64 / count;
    let last = (0..sizes.len()).rev().find(|&rank| two_sided(sizes[rank]) <= allowed(rank));
    last.map_or(f64::INFINITY, |rank| sizes[rank])
}

/// Groups of neighbours beyond a threshold, of one sign each.
fn joined(edges: &[[u32; 2]], z: &[f64], limit: f64) -> Vec<Vec<usize>> {
    let mut group: Vec<usize> = (0..z.len()).collect();
    fn root(group: &mut [usize], mut n: usize) -> usize {
        while group[n] != n {
            group[n] = group[group[n]];
            n = group[n];
        }
        n
    }
    for &[a, b] in edges {
        let (a, b) = (a as usize, b as usize);
        if z[a].abs() >= limit && z[b].abs() >= limit && z[a] * z[b] > 0.0 {
            let (a, b) = (root(&mut group, a), root(&mut group, b));
            group[a.max(b)] = a.min(b);
        }
    }
    let mut found = vec![Vec::new(); z.len()];
    for n in 0..z.len() {
        if z[n].abs() >= limit {
            found[root(&mut group, n)].push(n);
        }
    }
    found.retain(|nodes| nodes.len() >= FEWEST);
    found
}

/// Anatomy's name of a place on the skin of the reference pose (mm).
fn place(anatomy: &Anatomy, point: &Vec3) -> String {
    let Some((base, radius)) = anatomy.nearest(point) else { return "skin".into() };
    let [lateral, cranial] = base.elliptic(point);
    let part = if radius < 0.3 {
        "around the nipple"
    } else if radius > 0.85 && lateral > 0.4 && cranial > 0.4 {
        "axillary tail"
    } else if radius > 0.8 && cranial < -0.7 {
        "inframammary fold"
    } else if lateral.abs() < 0.3 {
        if cranial > 0.0 { "upper pole" } else { "lower pole" }
    } else {
        match (cranial > 0.0, lateral > 0.0) {
            (true, true) => "upper outer quadrant",
            (true, false) => "upper inner quadrant",
            (false, true) => "lower outer quadrant",
            (false, false) => "lower inner quadrant",
        }
    };
    format!("{} breast, {part}", base.side.name())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn noise_has_no_significant_node_but_once_in_twenty_times() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let alarms = (0..400)
            .filter(|_| {
                let z: Vec<f64> = (0..200).map(|_| StandardNormal.sample(&mut random)).collect();
                threshold(&z).is_finite()
            })
            .count();
        // 5 % of 400, and three standard deviations.
        assert!((8..=33).contains(&alarms), "{alarms}");
    }

    #[test]
    fn neighbours_of_one_sign_are_one_cluster() {
        // A strip of ten nodes: four out, then four in, a lonely pair apart.
        let edges: Vec<[u32; 2]> = (0..9).map(|n| [n, n + 1]).collect();
        let z = [5.0, 5.0, 6.0, 5.0, -5.0, -5.0, -5.0, -5.0, 0.0, 7.0];
        assert_eq!(joined(&edges, &z, 4.0), [vec![0, 1, 2, 3], vec![4, 5, 6, 7]]);
        assert!(joined(&edges, &z, f64::INFINITY).is_empty());
    }
}
