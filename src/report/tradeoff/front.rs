//! The Pareto front: what nothing else beats in both time and error.

/// Whether each of the points (time, error) lies on the front: no other is as fast and more accurate, or as accurate
/// and faster. What is not a finite number never does.
pub fn pareto(points: &[[f64; 2]]) -> Vec<bool> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&k| points[k].iter().all(|x| x.is_finite())).collect();
    order.sort_by(|&a, &b| points[a][0].total_cmp(&points[b][0]).then(points[a][1].total_cmp(&points[b][1])));
    let mut on = vec![false; points.len()];
    let mut least = f64::INFINITY;
    for k in order {
        if points[k][1] < least {
            least = points[k][1];
            on[k] = true;
        }
    }
    on
}

#[cfg(test)]
mod tests {
    use super::pareto;

    #[test]
    fn what_is_beaten_is_left_out() {
        let points =
            [[1.0, 5.0], [2.0, 5.0], [3.0, 1.0], [2.5, 3.0], [0.5, f64::NAN], [3.0, 2.0], [4.0, 0.5]];
        assert_eq!(pareto(&points), [true, false, true, true, false, false, true]);
        assert!(pareto(&[]).is_empty());
    }
}
