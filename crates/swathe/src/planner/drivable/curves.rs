//! The shortest curves of bounded curvature between two poses: Dubins (forward only) and Reeds-Shepp (reversing too).
//!
//! Sources: Dubins, "On curves of minimal length with a constraint on average curvature", American Journal of Mathematics
//! 79 (1957) 497-516; Reeds and Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific Journal of
//! Mathematics 145 (1990) 367-393, section 8, formulas 8.1 to 8.11. Every word that a formula gives is driven once, and
//! dropped where it does not end at the goal, so a formula can be incomplete but not wrong.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::grid::Position;

/// A word must end this near to the goal, in turning radii.
const TOLERANCE: f64 = 1e-6;

/// Arcs shorter than this are left out, in turning radii.
const NEGLIGIBLE: f64 = 1e-8;

/// Where a vehicle stands and where its nose points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Metres east.
    pub x_m: f64,
    /// Metres north.
    pub y_m: f64,
    /// Direction of the nose, counter-clockwise from east.
    pub heading_rad: f64,
}

impl Pose {
    /// A pose at a position.
    pub const fn new(position: Position, heading_rad: f64) -> Self {
        let Position { x_m, y_m } = position;
        Self { x_m, y_m, heading_rad }
    }

    /// Its place.
    pub const fn position(self) -> Position {
        Position::new(self.x_m, self.y_m)
    }

    /// The pose after driving a length along a curvature.
    #[must_use]
    pub fn after(self, arc: CurveArc) -> Self {
        let CurveArc {
            curvature_per_m: curvature,
            length_m,
        } = arc;
        let turn_rad = curvature * length_m;
        // The chord of an arc points along its middle heading.
        let half = turn_rad / 2.0;
        let chord_m = if half == 0.0 {
            length_m
        } else {
            length_m * half.sin() / half
        };
        let along = self.heading_rad + half;
        Self {
            x_m: self.x_m + chord_m * along.cos(),
            y_m: self.y_m + chord_m * along.sin(),
            heading_rad: principal(self.heading_rad + turn_rad),
        }
    }
}

/// A part of a curve with one curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveArc {
    /// Curvature of the track in 1/m: above zero the nose turns to the left when driving forward.
    pub curvature_per_m: f64,
    /// Length in metres, negative when driven in reverse.
    pub length_m: f64,
}

/// An angle between -π (excluded) and π.
pub(super) fn principal(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// Up to five arcs of unit radius: +1 left, 0 straight, -1 right, each with a signed length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Word {
    arcs: [(i8, f64); 5],
    count: usize,
}

impl Word {
    fn new(arcs: &[(i8, f64)]) -> Self {
        let mut word = Self {
            arcs: [(0, 0.0); 5],
            count: 0,
        };
        for &(turn, length) in arcs {
            if length.abs() > NEGLIGIBLE {
                word.arcs[word.count] = (turn, length);
                word.count += 1;
            }
        }
        word
    }

    fn parts(&self) -> &[(i8, f64)] {
        &self.arcs[..self.count]
    }

    fn parts_mut(&mut self) -> &mut [(i8, f64)] {
        &mut self.arcs[..self.count]
    }

    /// Its length in turning radii, reverse parts multiplied, with a charge for each change of direction.
    pub(super) fn weighted(&self, reverse_factor: f64, cusp: f64) -> f64 {
        let mut sum = 0.0;
        let mut before = 0.0;
        for &(_, length) in self.parts() {
            if length * before < 0.0 {
                sum += cusp;
            }
            sum += if length < 0.0 { -reverse_factor * length } else { length };
            before = length;
        }
        sum
    }

    /// The arcs at a turning radius.
    pub(super) fn arcs(&self, radius_m: f64) -> impl Iterator<Item = CurveArc> + '_ {
        self.parts().iter().map(move |&(turn, length)| CurveArc {
            curvature_per_m: f64::from(turn) / radius_m,
            length_m: length * radius_m,
        })
    }

    fn ends_at(&self, goal: Goal) -> bool {
        let start = Pose {
            x_m: 0.0,
            y_m: 0.0,
            heading_rad: 0.0,
        };
        let end = self.arcs(1.0).fold(start, Pose::after);
        let scale = 1.0 + goal.x.abs() + goal.y.abs();
        (end.x_m - goal.x).hypot(end.y_m - goal.y) < TOLERANCE * scale
            && principal(end.heading_rad - goal.heading).abs() < TOLERANCE
    }
}

/// A goal as seen from the start, in turning radii.
#[derive(Clone, Copy, Debug)]
struct Goal {
    x: f64,
    y: f64,
    heading: f64,
}

impl Goal {
    fn seen(from: Pose, to: Pose, radius_m: f64) -> Self {
        let (dx, dy) = (to.x_m - from.x_m, to.y_m - from.y_m);
        let (sin, cos) = from.heading_rad.sin_cos();
        Self {
            x: (dx * cos + dy * sin) / radius_m,
            y: (dy * cos - dx * sin) / radius_m,
            heading: principal(to.heading_rad - from.heading_rad),
        }
    }

    /// The same with left and right exchanged.
    fn mirrored(self) -> Self {
        Self {
            x: self.x,
            y: -self.y,
            heading: -self.heading,
        }
    }

    /// The same with forward and reverse exchanged.
    fn time_flipped(self) -> Self {
        Self {
            x: -self.x,
            y: self.y,
            heading: -self.heading,
        }
    }

    /// Where the arcs of a way here lead in the opposite order.
    fn backwards(self) -> Self {
        let (sin, cos) = self.heading.sin_cos();
        Self {
            x: self.x * cos + self.y * sin,
            y: self.x * sin - self.y * cos,
            heading: self.heading,
        }
    }
}

/// Every Dubins and Reeds-Shepp word from one pose to another, in a fixed order.
pub(super) fn words(from: Pose, to: Pose, radius_m: f64) -> Vec<Word> {
    let goal = Goal::seen(from, to, radius_m);
    let mut found = Vec::with_capacity(32);
    dubins_words(goal, &mut found);
    reeds_shepp_words(goal, &mut found);
    found
}

/// The shortest curve that is driven forward only, with every curvature within 1/radius.
///
/// `radius_m` must be above zero.
pub fn dubins(from: Pose, to: Pose, radius_m: f64) -> Vec<CurveArc> {
    let mut found = Vec::new();
    dubins_words(Goal::seen(from, to, radius_m), &mut found);
    shortest(&found, radius_m)
}

/// The shortest curve that may reverse, with every curvature within 1/radius.
///
/// `radius_m` must be above zero.
pub fn reeds_shepp(from: Pose, to: Pose, radius_m: f64) -> Vec<CurveArc> {
    shortest(&words(from, to, radius_m), radius_m)
}

fn shortest(words: &[Word], radius_m: f64) -> Vec<CurveArc> {
    let length = |word: &&Word| word.weighted(1.0, 0.0);
    let best = words.iter().min_by(|a, b| length(a).total_cmp(&length(b)));
    best.map_or_else(Vec::new, |word| word.arcs(radius_m).collect())
}

/// Turns between 0 and 2π; what rounding puts just below a full turn is none.
fn turn(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if TAU - turned < 1e-9 { 0.0 } else { turned }
}

/// The six words of Dubins, from the tangents of the circles beside start and goal.
fn dubins_words(goal: Goal, found: &mut Vec<Word>) {
    for mirror in [false, true] {
        let seen = if mirror { goal.mirrored() } else { goal };
        let (sin, cos) = seen.heading.sin_cos();
        let mut emit = |arcs: [(i8, f64); 3]| {
            let mut word = Word::new(&arcs);
            for part in word.parts_mut() {
                part.0 = if mirror { -part.0 } else { part.0 };
            }
            if word.ends_at(goal) {
                found.push(word);
            }
        };
        // From the left circle at the start to the left circle at the goal.
        let (dx, dy) = (seen.x - sin, seen.y + cos - 1.0);
        let (distance, bearing) = (dx.hypot(dy), dy.atan2(dx));
        emit([(1, turn(bearing)), (0, distance), (1, turn(seen.heading - bearing))]);
        if distance <= 4.0 {
            for side in [-1.0, 1.0] {
                let first = bearing + side * (distance / 4.0).acos();
                // The third circle touches both.
                let (mx, my) = (2.0 * first.cos(), 2.0 * first.sin());
                let second = (dy - my).atan2(dx - mx);
                emit([
                    (1, turn(first + FRAC_PI_2)),
                    (-1, turn(first + PI - second)),
                    (1, turn(seen.heading - second + FRAC_PI_2)),
                ]);
            }
        }
        // To the right circle at the goal.
        let (dx, dy) = (seen.x + sin, seen.y - cos - 1.0);
        let distance = dx.hypot(dy);
        if distance >= 2.0 {
            let straight = (distance * distance - 4.0).max(0.0).sqrt();
            let heading = dy.atan2(dx) + 2f64.atan2(straight);
            emit([(1, turn(heading)), (0, straight), (-1, turn(heading - seen.heading))]);
        }
    }
}

/// The words of Reeds and Shepp under their symmetries.
fn reeds_shepp_words(goal: Goal, found: &mut Vec<Word>) {
    for backwards in [false, true] {
        for flip in [false, true] {
            for mirror in [false, true] {
                let mut seen = goal;
                if backwards {
                    seen = seen.backwards();
                }
                if flip {
                    seen = seen.time_flipped();
                }
                if mirror {
                    seen = seen.mirrored();
                }
                base_words(seen, backwards, &mut |arcs| {
                    let mut word = Word::new(arcs);
                    for part in word.parts_mut() {
                        part.0 = if mirror { -part.0 } else { part.0 };
                        part.1 = if flip { -part.1 } else { part.1 };
                    }
                    if backwards {
                        word.parts_mut().reverse();
                    }
                    if word.ends_at(goal) {
                        found.push(word);
                    }
                });
            }
        }
    }
}

/// Formulas 8.1 to 8.11. Families that are their own reverse are left out when the order of arcs is turned round.
fn base_words(goal: Goal, backwards: bool, emit: &mut impl FnMut(&[(i8, f64)])) {
    const QUARTER: f64 = FRAC_PI_2;
    let Goal { x, y, heading: phi } = goal;
    let (sin, cos) = phi.sin_cos();
    // The centres of the circles at the goal, seen from the left circle at the start.
    let (left_x, left_y) = (x - sin, y - 1.0 + cos);
    let (right_x, right_y) = (x + sin, y - 1.0 - cos);
    let (left, right) = (left_x.hypot(left_y), right_x.hypot(right_y));
    let left_bearing = left_y.atan2(left_x);
    if left <= 4.0 {
        // 8.3 and 8.4: C|C|C and C|CC; turned round CC|C.
        let u = -2.0 * (left / 4.0).asin();
        let t = principal(left_bearing + u / 2.0 + PI);
        emit(&[(1, t), (-1, u), (1, principal(phi - t + u))]);
    }
    if left >= 2.0 {
        // 8.9: C|C[π/2]SC.
        let straight = (left * left - 4.0).max(0.0).sqrt();
        let t = principal(left_bearing + straight.atan2(-2.0));
        let v = principal(phi - QUARTER - t);
        emit(&[(1, t), (-1, -QUARTER), (0, 2.0 - straight), (1, v)]);
    }
    if right >= 2.0 {
        // 8.10.
        let t = right_x.atan2(-right_y);
        emit(&[
            (1, t),
            (-1, -QUARTER),
            (0, 2.0 - right),
            (-1, principal(t + QUARTER - phi)),
        ]);
    }
    if backwards {
        return;
    }
    // 8.1: CSC with equal turns.
    emit(&[(1, left_bearing), (0, left), (1, principal(phi - left_bearing))]);
    if right >= 2.0 {
        // 8.2: CSC with opposite turns.
        let straight = (right * right - 4.0).max(0.0).sqrt();
        let t = principal(right_y.atan2(right_x) + 2f64.atan2(straight));
        emit(&[(1, t), (0, straight), (-1, principal(t - phi))]);
        // 8.11: C|C[π/2]SC[π/2]|C.
        let u = 4.0 - straight;
        if u <= 0.0 {
            let t = ((4.0 - u) * right_x - 2.0 * right_y).atan2(-2.0 * right_x + (u - 4.0) * right_y);
            let v = principal(t - phi);
            emit(&[(1, t), (-1, -QUARTER), (0, u), (1, -QUARTER), (-1, v)]);
        }
    }
    // 8.7: CC[u]|C[u]C.
    let rho = (2.0 + right) / 4.0;
    if rho <= 1.0 {
        let u = rho.acos();
        let (t, v) = outer_turns(u, -u, right_x, right_y, phi);
        emit(&[(1, t), (-1, u), (1, -u), (-1, v)]);
    }
    // 8.8: C|C[u]C[u]|C.
    let rho = (20.0 - right * right) / 16.0;
    if (0.0..=1.0).contains(&rho) {
        let u = -rho.acos();
        let (t, v) = outer_turns(u, u, right_x, right_y, phi);
        emit(&[(1, t), (-1, u), (1, u), (-1, v)]);
    }
}

/// The outer turns of a word of four arcs (τ and ω of the paper).
fn outer_turns(u: f64, v: f64, x: f64, y: f64, phi: f64) -> (f64, f64) {
    let difference = principal(u - v);
    let a = u.sin() - difference.sin();
    let b = u.cos() - difference.cos() - 1.0;
    let t = (y * a - x * b).atan2(x * a + y * b);
    let sign = 2.0 * (difference.cos() - v.cos() - u.cos()) + 3.0;
    let tau = if sign < 0.0 { principal(t + PI) } else { principal(t) };
    (tau, principal(tau - u + v - phi))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    fn origin() -> Pose {
        Pose::new(Position::new(0.0, 0.0), 0.0)
    }

    fn length(arcs: &[CurveArc]) -> f64 {
        arcs.iter().map(|arc| arc.length_m.abs()).sum()
    }

    fn assert_ends(from: Pose, to: Pose, arcs: &[CurveArc]) {
        let end = arcs.iter().fold(from, |pose, &arc| pose.after(arc));
        assert!(end.position().distance_m(to.position()) < 1e-4, "{end:?} {to:?}");
        assert!(principal(end.heading_rad - to.heading_rad).abs() < 1e-5);
    }

    /// An arc of any kind that a car can drive.
    fn any_arc(forward: bool) -> impl Strategy<Value = CurveArc> {
        let low = if forward { 0.0 } else { -4.0 };
        let curvature = prop_oneof![Just(-1.0), Just(0.0), Just(1.0), -1.0f64..1.0];
        (curvature, low..4.0).prop_map(|(curvature_per_m, length_m)| CurveArc {
            curvature_per_m,
            length_m,
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        // Brute force: no drawn sequence of arcs is shorter than the curve to where it ends.
        #[test]
        fn no_way_with_reversing_is_shorter(arcs in prop::collection::vec(any_arc(false), 1..6)) {
            let end = arcs.iter().fold(origin(), |pose, &arc| pose.after(arc));
            let best = reeds_shepp(origin(), end, 1.0);
            assert_ends(origin(), end, &best);
            prop_assert!(length(&best) <= length(&arcs) + 1e-5, "{} {}", length(&best), length(&arcs));
        }

        #[test]
        fn no_way_forward_is_shorter(arcs in prop::collection::vec(any_arc(true), 1..6)) {
            let end = arcs.iter().fold(origin(), |pose, &arc| pose.after(arc));
            let best = dubins(origin(), end, 1.0);
            assert_ends(origin(), end, &best);
            prop_assert!(best.iter().all(|arc| arc.length_m > 0.0));
            prop_assert!(length(&best) <= length(&arcs) + 1e-5, "{} {}", length(&best), length(&arcs));
            prop_assert!(length(&reeds_shepp(origin(), end, 1.0)) <= length(&best) + 1e-5);
        }

        #[test]
        fn radius_and_frame_only_scale_and_move(
            x in -9.0f64..9.0, y in -9.0f64..9.0, heading in -3.1f64..3.1, turned in -3.1f64..3.1, radius in 0.5f64..20.0,
        ) {
            let to = Pose::new(Position::new(x, y), heading);
            let unit = length(&reeds_shepp(origin(), to, 1.0));
            let from = Pose::new(Position::new(5e5, 5e6), turned);
            let (sin, cos) = turned.sin_cos();
            let moved = Pose {
                x_m: from.x_m + radius * (x * cos - y * sin),
                y_m: from.y_m + radius * (x * sin + y * cos),
                heading_rad: heading + turned,
            };
            let arcs = reeds_shepp(from, moved, radius);
            assert_ends(from, moved, &arcs);
            prop_assert!((length(&arcs) - radius * unit).abs() < 1e-4 * radius);
        }
    }

    #[test]
    fn lengths_known_by_geometry() {
        let to = |x, y, heading| Pose::new(Position::new(x, y), heading);
        // Straight on; a half circle; parking sideways by three arcs; turning on the spot by three arcs of 60 degrees.
        assert_relative_eq!(length(&dubins(origin(), to(5.0, 0.0, 0.0), 1.0)), 5.0, epsilon = 1e-9);
        assert_relative_eq!(length(&dubins(origin(), to(0.0, 2.0, PI), 1.0)), PI, epsilon = 1e-9);
        assert_relative_eq!(
            length(&reeds_shepp(origin(), to(-5.0, 0.0, 0.0), 1.0)),
            5.0,
            epsilon = 1e-9
        );
        assert_relative_eq!(
            length(&reeds_shepp(origin(), to(0.0, 0.0, PI), 1.0)),
            PI,
            epsilon = 1e-6
        );
        assert_eq!(reeds_shepp(origin(), origin(), 1.0), Vec::new());
    }
}
