//! Analytic hierarchy process: weights from pairwise comparisons, with their consistency.
//!
//! Source: Saaty 1980; the random indices for 1 to 10 criteria are the usual table.

use super::RankError;

const RANDOM_INDEX: [f64; 10] = [0.0, 0.0, 0.58, 0.90, 1.12, 1.24, 1.32, 1.41, 1.45, 1.49];

/// Greatest consistency ratio that counts as consistent.
const GREATEST_RATIO: f64 = 0.10;

/// Weights and how far the comparisons agree with each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Ahp {
    /// One weight per criterion; they sum to 1.
    pub weights: Vec<f64>,
    /// Principal eigenvalue.
    pub lambda_max: f64,
    /// Consistency ratio; 0 is perfect, up to 0.10 acceptable.
    pub consistency_ratio: f64,
}

/// Weights of a reciprocal comparison matrix (`matrix[i][j]` = how much more criterion i counts than j, 1/9 to 9).
///
/// # Errors
/// [`RankError::Matrix`] when it is not square, not reciprocal, or out of range; [`RankError::Inconsistent`] when the
/// consistency ratio exceeds 0.10 and `force` is not set.
pub fn ahp(matrix: &[Vec<f64>], force: bool) -> Result<Ahp, RankError> {
    let n = matrix.len();
    check(matrix)?;
    let mut weights = vec![1.0 / n as f64; n];
    let mut lambda_max = n as f64;
    for _ in 0..10_000 {
        let product: Vec<f64> = matrix
            .iter()
            .map(|row| row.iter().zip(&weights).map(|(a, w)| a * w).sum())
            .collect();
        let ratios = product.iter().zip(&weights).map(|(aw, w)| aw / w);
        lambda_max = ratios.sum::<f64>() / n as f64;
        let total: f64 = product.iter().sum();
        let next: Vec<f64> = product.iter().map(|value| value / total).collect();
        let change = next.iter().zip(&weights).map(|(a, b)| (a - b).abs());
        let largest = change.fold(0.0, f64::max);
        weights = next;
        if largest < 1e-12 {
            break;
        }
    }
    let consistency_ratio = if n <= 2 {
        0.0
    } else {
        ((lambda_max - n as f64) / (n as f64 - 1.0) / RANDOM_INDEX[n - 1]).max(0.0)
    };
    if consistency_ratio > GREATEST_RATIO && !force {
        return Err(RankError::Inconsistent {
            ratio: consistency_ratio,
        });
    }
    Ok(Ahp {
        weights,
        lambda_max,
        consistency_ratio,
    })
}

fn check(matrix: &[Vec<f64>]) -> Result<(), RankError> {
    let n = matrix.len();
    let fail = |why: String| Err(RankError::Matrix { why });
    if n == 0 || n > RANDOM_INDEX.len() {
        return fail(format!("it has {n} criteria, 1 to 10 are allowed"));
    }
    for (i, row) in matrix.iter().enumerate() {
        if row.len() != n {
            return fail(format!("row {i} has {} entries instead of {n}", row.len()));
        }
        for (j, &value) in row.iter().enumerate() {
            if !(1.0 / 9.000_001..=9.000_001).contains(&value) {
                return fail(format!("entry ({i}, {j}) is {value}, 1/9 to 9 is allowed"));
            }
            let mirrored = matrix[j].get(i).copied().unwrap_or(f64::NAN);
            if (value * mirrored - 1.0).abs() > 1e-6 {
                return fail(format!("entries ({i}, {j}) and ({j}, {i}) are not reciprocal"));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    #[test]
    fn equal_comparisons_give_equal_weights() {
        let result = ahp(&[vec![1.0, 1.0], vec![1.0, 1.0]], false).unwrap();
        assert_eq!(result.weights, [0.5, 0.5]);
        assert_eq!(result.consistency_ratio, 0.0);
    }

    #[test]
    fn a_textbook_matrix_has_its_published_ratio() {
        // Saaty's scale, three criteria: 1, 3, 5 / 1, 3 / 1; eigenvalue 3.0385, ratio 0.033.
        let third = 1.0 / 3.0;
        let matrix = [vec![1.0, 3.0, 5.0], vec![third, 1.0, 3.0], vec![0.2, third, 1.0]];
        let result = ahp(&matrix, false).unwrap();
        assert_relative_eq!(result.lambda_max, 3.0385, epsilon = 1e-4);
        assert_relative_eq!(result.consistency_ratio, 0.0332, epsilon = 1e-4);
        assert_relative_eq!(result.weights[0], 0.6370, epsilon = 1e-4);
    }

    #[test]
    fn contradictions_are_refused_unless_forced() {
        let matrix = [
            vec![1.0, 9.0, 1.0 / 9.0],
            vec![1.0 / 9.0, 1.0, 9.0],
            vec![9.0, 1.0 / 9.0, 1.0],
        ];
        assert!(matches!(ahp(&matrix, false), Err(RankError::Inconsistent { .. })));
        assert!(ahp(&matrix, true).unwrap().consistency_ratio > 1.0);
        for bad in [vec![], vec![vec![1.0, 2.0], vec![2.0, 1.0]], vec![vec![f64::NAN]]] {
            assert!(matches!(ahp(&bad, false), Err(RankError::Matrix { .. })));
        }
    }

    proptest! {
        #[test]
        fn consistent_matrices_return_their_weights(raw in prop::collection::vec(1.0f64..2.9, 2..6)) {
            let total: f64 = raw.iter().sum();
            let matrix: Vec<Vec<f64>> = raw.iter().map(|a| raw.iter().map(|b| a / b).collect()).collect();
            let result = ahp(&matrix, false).unwrap();
            for (weight, value) in result.weights.iter().zip(&raw) {
                prop_assert!((weight - value / total).abs() < 1e-9);
            }
        }
    }
}
