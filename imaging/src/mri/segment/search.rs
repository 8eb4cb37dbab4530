//! Optimal smooth surfaces: one offset for each column of a (u, v) map.

/// Cost of each offset in each column; offsets run fastest, then u, then v.
pub(super) struct Columns {
    pub n_u: usize,
    pub n_v: usize,
    pub n_offset: usize,
    pub cost: Vec<f32>,
}

/// The offset of each column that costs least when a change of one offset between neighbours
/// costs `step_cost`.
///
/// Costs are carried along lines in eight directions, each an exact dynamic programme, and added
/// (semi-global matching: Hirschmüller 2008, <https://doi.org/10.1109/TPAMI.2007.1166>).
pub(super) fn optimal_surface(columns: &Columns, step_cost: f32) -> Vec<usize> {
    let mut sum = vec![0.0f32; columns.cost.len()];
    for (du, dv) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)] {
        carry(columns, (du, dv), step_cost, &mut sum);
    }
    let least = |costs: &[f32]| {
        let mut best = 0;
        for (n, cost) in costs.iter().enumerate() {
            if *cost < costs[best] {
                best = n;
            }
        }
        best
    };
    sum.chunks(columns.n_offset).map(least).collect()
}

/// Adds the cost of the best path that arrives at each column in one direction.
fn carry(columns: &Columns, (du, dv): (isize, isize), step_cost: f32, sum: &mut [f32]) {
    let (n_u, n_v, n) = (columns.n_u, columns.n_v, columns.n_offset);
    let mut arrived = vec![0.0f32; columns.cost.len()];
    let mut best = vec![0.0f32; n];
    for step_v in 0..n_v {
        let v = if dv < 0 { n_v - 1 - step_v } else { step_v };
        for step_u in 0..n_u {
            let u = if du < 0 { n_u - 1 - step_u } else { step_u };
            let before = (u.wrapping_add_signed(-du), v.wrapping_add_signed(-dv));
            best.fill(0.0);
            if before.0 < n_u && before.1 < n_v {
                let from = (before.1 * n_u + before.0) * n;
                best.copy_from_slice(&arrived[from..from + n]);
                for r in 1..n {
                    best[r] = best[r].min(best[r - 1] + step_cost);
                }
                for r in (1..n).rev() {
                    best[r - 1] = best[r - 1].min(best[r] + step_cost);
                }
                let least = best.iter().copied().fold(f32::INFINITY, f32::min);
                best.iter_mut().for_each(|b| *b -= least);
            }
            let at = (v * n_u + u) * n;
            for r in 0..n {
                arrived[at + r] = columns.cost[at + r] + best[r];
                sum[at + r] += arrived[at + r];
            }
        }
    }
}

/// The map that minimises Σ w (s - data)² + stiffness Σ (Δs)², by conjugate gradients.
///
/// The second differences along u and v are those of a thin plate with free edges, so that
/// planes and columns without weight cost nothing.
pub(super) fn smooth_map(
    data: &[f32],
    weight: &[f32],
    [n_u, n_v]: [usize; 2],
    [stiffness_u, stiffness_v]: [f64; 2],
) -> Vec<f32> {
    let bend = |s: &[f64], out: &mut [f64]| {
        let mut second = |a: usize, b: usize, c: usize, stiffness: f64| {
            let d = stiffness * (s[a] - 2.0 * s[b] + s[c]);
            out[a] += d;
            out[b] -= 2.0 * d;
            out[c] += d;
        };
        for v in 0..n_v {
            for u in 1..n_u.saturating_sub(1) {
                let n = v * n_u + u;
                second(n - 1, n, n + 1, stiffness_u);
            }
        }
        for v in 1..n_v.saturating_sub(1) {
            for u in 0..n_u {
                let n = v * n_u + u;
                second(n - n_u, n, n + n_u, stiffness_v);
            }
        }
    };
    let apply = |s: &[f64], out: &mut [f64]| {
        for n in 0..s.len() {
            // The small constant keeps the system definite if hardly a column has weight.
            out[n] = (f64::from(weight[n]) + 1e-6) * s[n];
        }
        bend(s, out);
    };
    let mut s: Vec<f64> = data.iter().map(|&d| f64::from(d)).collect();
    let mut product = vec![0.0; s.len()];
    apply(&s, &mut product);
    let mut residual: Vec<f64> = (0..s.len())
        .map(|n| (f64::from(weight[n]) + 1e-6) * f64::from(data[n]) - product[n])
        .collect();
    let mut direction = residual.clone();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut norm = dot(&residual, &residual);
    let enough = 1e-12 * norm.max(1e-300);
    for _ in 0..2000 {
        if norm <= enough {
            break;
        }
        apply(&direction, &mut product);
        let step = norm / dot(&direction, &product);
        for n in 0..s.len() {
            s[n] += step * direction[n];
            residual[n] -= step * product[n];
        }
        let next = dot(&residual, &residual);
        for n in 0..s.len() {
            direction[n] = residual[n] + next / norm * direction[n];
        }
        norm = next;
    }
    s.iter().map(|&v| v as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_surface_follows_the_cheap_offsets_across_a_gap_and_ignores_a_decoy() {
        let (n_u, n_v, n_offset) = (30, 20, 25);
        let truth = |u: usize, v: usize| 8 + u / 5 + v / 7;
        let mut cost = vec![1.0; n_u * n_v * n_offset];
        for v in 0..n_v {
            for u in 0..n_u {
                let at = (v * n_u + u) * n_offset;
                let gap = (10..14).contains(&u) && (5..9).contains(&v);
                cost[at + truth(u, v)] = if gap { 1.0 } else { 0.2 };
                if gap {
                    cost[at + 20] = 0.1;
                }
            }
        }
        let found = optimal_surface(&Columns { n_u, n_v, n_offset, cost }, 0.3);
        for v in 0..n_v {
            for u in 0..n_u {
                assert!(found[v * n_u + u].abs_diff(truth(u, v)) <= 1, "{u} {v}");
            }
        }
    }

    #[test]
    fn a_smooth_map_extends_a_plane_over_columns_without_weight() {
        let (n_u, n_v) = (20, 15);
        let plane = |n: usize| 3.0 + 0.5 * (n % n_u) as f32 - 0.25 * (n / n_u) as f32;
        let known = |n: usize| !(6..12).contains(&(n % n_u));
        let data: Vec<f32> =
            (0..n_u * n_v).map(|n| if known(n) { plane(n) } else { 0.0 }).collect();
        let weight: Vec<f32> = (0..n_u * n_v).map(|n| f32::from(u8::from(known(n)))).collect();
        let smooth = smooth_map(&data, &weight, [n_u, n_v], [5.0, 5.0]);
        for n in 0..n_u * n_v {
            assert!((smooth[n] - plane(n)).abs() < 2e-2, "{n}: {} {}", smooth[n], plane(n));
        }
    }
}
