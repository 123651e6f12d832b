//! Table I of the paper: goodness from the difference of grey levels.

/// Which neighbours' differences count, the paper giving one value per cell for "different directions".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// The worst of eight, a diagonal counted per unit of distance.
    Worst,
    /// The mean of eight.
    Mean,
    /// The best of eight.
    Best,
    /// The worst of the four that share an edge.
    Four,
}

/// How the table's bins are read where it contradicts itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bands {
    /// The same bins for both signs: 0, 1-66, 67-129, 130-192, 193-255.
    Symmetric,
    /// As printed: +127..+129 lie in no bin (they count as 3) and -192 in two (it counts as 1).
    Literal,
}

/// How real-valued differences of averaged cells meet integer bins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rounding {
    /// Round half away from zero first.
    HalfAway,
    /// Bins are half-open on the real line: (0, 66], (66, 129], ...
    Real,
}

/// Goodness 5 (level) to 1 of a signed difference of grey levels.
pub fn height_goodness(difference: f64, bands: Bands, rounding: Rounding) -> u8 {
    let difference = match rounding {
        Rounding::HalfAway => difference.round(),
        Rounding::Real => difference,
    };
    if bands == Bands::Literal && difference == -192.0 {
        return 1;
    }
    match difference.abs() {
        0.0 => 5,
        d if d <= 66.0 => 4,
        d if d <= 129.0 => 3,
        d if d <= 192.0 => 2,
        _ => 1,
    }
}

/// Goodness of a cell from its signed differences to the neighbours `(difference per unit distance, is an edge)`.
pub(super) fn goodness_of(
    differences: impl Iterator<Item = (f64, bool)>,
    directions: Directions,
    bands: Bands,
    rounding: Rounding,
) -> u8 {
    let mut worst = (0.0_f64, 0.0_f64);
    let mut best = f64::INFINITY;
    let (mut sum, mut count) = (0.0, 0.0);
    for (difference, edge) in differences {
        if directions == Directions::Four && !edge {
            continue;
        }
        if difference.abs() > worst.0 {
            worst = (difference.abs(), difference);
        }
        best = best.min(difference.abs());
        sum += difference.abs();
        count += 1.0;
    }
    let chosen = match directions {
        _ if count == 0.0 => 0.0,
        Directions::Worst | Directions::Four => worst.1,
        Directions::Mean => sum / count,
        Directions::Best => best,
    };
    height_goodness(chosen, bands, rounding)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rstest::rstest;

    #[rstest]
    #[case(0.0, 5)]
    #[case(0.49, 5)]
    #[case(0.5, 4)]
    #[case(66.0, 4)]
    #[case(66.5, 3)]
    #[case(127.0, 3)]
    #[case(129.0, 3)]
    #[case(130.0, 2)]
    #[case(192.0, 2)]
    #[case(193.0, 1)]
    #[case(255.0, 1)]
    fn table_one_for_both_signs(#[case] difference: f64, #[case] goodness: u8) {
        for signed in [difference, -difference] {
            assert_eq!(height_goodness(signed, Bands::Symmetric, Rounding::HalfAway), goodness);
        }
    }

    #[test]
    fn the_printed_overlap_and_real_bins_are_selectable() {
        assert_eq!(height_goodness(-192.0, Bands::Literal, Rounding::HalfAway), 1);
        assert_eq!(height_goodness(192.0, Bands::Literal, Rounding::HalfAway), 2);
        assert_eq!(height_goodness(128.0, Bands::Literal, Rounding::HalfAway), 3);
        assert_eq!(height_goodness(0.1, Bands::Symmetric, Rounding::Real), 4);
        assert_eq!(height_goodness(66.4, Bands::Symmetric, Rounding::Real), 3);
        assert_eq!(height_goodness(66.4, Bands::Symmetric, Rounding::HalfAway), 4);
    }

    #[test]
    fn directions_choose_among_differences() {
        let differences = [(0.0, true), (-70.0, false), (10.0, true)];
        let goodness = |directions| {
            goodness_of(
                differences.into_iter(),
                directions,
                Bands::Symmetric,
                Rounding::HalfAway,
            )
        };
        assert_eq!(goodness(Directions::Worst), 3);
        assert_eq!(goodness(Directions::Four), 4);
        assert_eq!(goodness(Directions::Mean), 4);
        assert_eq!(goodness(Directions::Best), 5);
    }
}
