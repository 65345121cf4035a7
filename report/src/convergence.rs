//! The document on convergence and calm: what the means owe to the numerics.

mod honesty;
mod over_wing;
mod refinement;
mod sample;
mod smoothness;
mod spreading;
mod strokes;
mod trials;

use std::io;

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_numerics::table::Table as _;
use manduca_numerics::uvlm::Settings;

use crate::flights::Flight;
use crate::markdown::{Document, Table, fixed, significant};
use crate::output::Report;
pub use sample::{SEED, Sample};

/// How much is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Random strokes beside the published ones, for trials and refinement.
    pub strokes: u64,
    /// Random strokes for the standard errors.
    pub errors: u64,
    /// Random lines for the smoothness.
    pub lines: u64,
}

impl Default for Effort {
    fn default() -> Self {
        Self { strokes: 20, errors: 100, lines: 10 }
    }
}

/// Computes everything; `tell` hears what is being done.
///
/// # Errors
/// When a figure cannot be drawn or too few strokes of the design box are feasible.
pub fn compute(effort: Effort, tell: &mut dyn FnMut(&str)) -> io::Result<Report> {
    let settings = Settings::default();
    let mut document = Document::new("Convergence and calm");
    introduction(&mut document, effort);
    let sample = Sample::new(effort.strokes)?;
    tell("trials");
    let reference = sample.fly(settings);
    trials::write_wake(&mut document, &sample, &reference, settings);
    trials::write_cores(&mut document, &sample, &reference, settings);
    tell("wings over wake just shed");
    over_wing::write(&mut document, effort.strokes.div_ceil(2), settings)?;
    tell("spreading");
    spreading::write(&mut document, &sample, settings);
    tell("lattice");
    trials::write_lattice(&mut document, &sample, &reference, settings);
    tell("meshes");
    refinement::write_meshes(&mut document, &sample, settings);
    tell("refinement");
    refinement::write_refinement(&mut document, &sample, settings);
    tell("standard errors");
    honesty::write(&mut document, effort.errors, settings)?;
    tell("smoothness");
    let figure = smoothness::write(&mut document, effort.lines, settings)?;
    remarks(&mut document);
    Ok(Report { name: "convergence.md", text: document.text().to_owned(), figures: vec![figure] })
}

fn introduction(document: &mut Document, effort: Effort) {
    document.paragraph(&format!(
        "`manduca report convergence` computes and writes this page (solver_version {SOLVER_VERSION}). It flies the five \
         published strokes and {} random ones of the design box (Table 2 of the paper, strokes {} of seed {SEED}) with \
         changed settings, and shows by how much the stroke means move. Changes count in hundredths of the weight W (L+ \
         and D+), of W c (M+) and of 84.2 mW (P+), as root mean squares over all strokes. Random strokes need up to seven \
         times 84.2 mW: columns of *relative* changes count L+ and P+ relative to themselves where they are above one. \
         *Mean* changes have their signs; the last column is the median standard error of L+, in hundredths of W.",
        effort.strokes,
        if effort.strokes > 0 { format!("0 to {}", effort.strokes - 1) } else { "none".into() },
    ));
    document.paragraph("Default settings (lengths in mean chords c, times in strokes):");
    let mut table = Table::new(["setting", "value", "what"]);
    for field in Settings::FIELDS {
        let value = if field.whole { fixed(field.default, 0) } else { significant(field.default, 3) };
        let unit = if field.unit.is_empty() { String::new() } else { format!(" {}", field.unit) };
        table.row([field.name.to_owned(), format!("{value}{unit}"), field.meaning.to_owned()]);
    }
    document.table(&table);
}

fn remarks(document: &mut Document) {
    document.heading("What was learnt on the way");
    for text in REMARKS {
        document.paragraph(text);
    }
}

/// What the numbers above do not say: choices whose alternatives are no longer in the code.
const REMARKS: [&str; 17] = [
    "**Calm comes from old wake, not from fresh.** Cores which grow with the root of age (`wake_spreading`) let the \
     remembered wake lose its fine structure before it meets the wing again. The strokes then settle to one periodic \
     stroke: what looks like scatter is a transient which decays, and dropping four strokes instead of two removes most \
     of it. A large constant core of wake on wake does the same at the price of the fresh wake.",
    "**The wake may be forgotten if its jet is not.** Cutting the wake after two strokes without more removes the \
     downwash of the jet beyond. Sinks for the forgotten rows (`wake_tail`) put it back to leading order; with them \
     two strokes do what four do without. Small radii excite a \
     slow oscillation of the wake's end.",
    "**A core belongs to the distance from the vortex, not from its line.** The usual core counts the distance h from the \
     line on which a segment lies, h²/(h² + c²), and so takes from the air far ahead of a trailing vortex as much as from \
     the air beside it, where nothing is near. Vorticity spread evenly over its core (Rosenhead 1930, Moore 1972) does \
     not. With the usual core and the settings of solver_version 6 a wake remembered twice as long moved the means by \
     1.18, 1.50, 1.30 and 0.86 hundredths (L+, D+, M+, P+), half of the spreading by 3.03, 2.67, 2.48 and 1.86, an \
     elliptic wing had 4.4 % too little induced drag and a wing of aspect ratio 8 a lift slope 1.6 % too high; with this one \
     0.91, 0.64, 0.78 and 0.59; 2.57, 2.29, 1.96 and 1.80; 1.8 % and 1.0 %. It costs less than the usual one.",
    "**The core seen by the wing must grow with age, not with its root.** Near the trailing edge distance is \
     proportional to age; a core which grows as the root of age is larger than the distance for small ages and blurs \
     the edge's own wake more with every shorter step: lift then depends far more on the time step.",
    "**The newest wake acts from one place and leaves from another.** The sheet shed in a step does to the wing what a \
     line at a quarter of the step does, as seen by a plate; a lattice answers a line that close too weakly, so the line \
     lies closer by the ratio of two gamma functions (`first_row.rs`). When it becomes free it starts from the middle of \
     the trailing edge's own path. One place for both, as is usual, costs 5 % of the lift of an oscillating plate at \
     eight panels, and an error of first order in the step: against steps 2.75 times finer the random strokes were off \
     by 7.8, 5.9, 5.7 and 17 hundredths (L+, D+, M+, P+), then by about 2, 2.4, 1.8 and 3.6. Half as many steps and half as many \
     panels hid most of it from each other.",
    "**Rows of old wake may lie as far apart as they are blurred.** Every other row is joined to its neighbour at an \
     eighth of a stroke, again at half of one and at two: rows lie apart by the root of their age, as wide as their cores \
     have spread. A flight then takes a fifth of its time, which was spent on strips and steps. What joining \
     changes is for three quarters in two strokes of the 25 which answer anything by several hundredths (random 0 and 13). \
     Rows this far apart want a wake which spreads by more than a chord in a stroke: remembered twice as long, one which \
     spreads to 1.4 c moves L+ and D+ by 0.7 hundredths, to 0.8 to 1.2 c by 1.4 to 1.8. Every stroke must keep the same rows, \
     which are joined by their step in the stroke: by their number since the start, a longer wake or other steps per \
     stroke would have a wake of another shape after every other stroke.",
    "**A smaller core of fresh wake is less of a choice, and needs a wake which spreads faster.** With 0.25 c for fresh wake \
     and a spreading to 1 c in a stroke, halving all cores moved L+ by 3.1 hundredths; with 0.125 c and 1.4 c by 1.9, \
     and the means themselves differ by one hundredth between the two. What the spreading does is two things which \
     nearly cancel in lift: halved as the wing alone sees it, the published strokes lose 4 to 5 hundredths; halved as the wake \
     alone sees it, they gain 3 to 5. So the mean L+ of the published strokes hardly depends on it (0.877 at 0.7 c, 0.867 \
     at 1 c, 0.868 at 1.4 c, 0.879 at 1.8 c), while violent strokes do. 1.2 c passes every canonical \
     check which the spreading can spoil; 1.4 c is calmer and misses the lift slope at aspect ratio 8 by a hair.",
    "**How fast old wake spreads is physics, and a choice.** With the errors of the means out of the way half of it \
     still moves the 25 strokes by 2.2, 2.0, 1.9 and 1.9 hundredths. Nearly half of the sum of squares in L+ is random \
     8 (1.7 without it), which beats by 31° to either side and stays in what it shed; half of that in D+ is \
     random 18 and 10. Random 8 follows it smoothly, from 0.50 at 1.5 c to 0.62 at 0.6 c, random 18 down to 0.75 c: no \
     leap between two answers which a better lattice would settle, but the age at which vortices of a turbulent wake have decayed, which a \
     lattice has to be told. Nor would another default be less of a choice: half of 0.8, 1.0 and 1.4 c moves L+ by 3.0, 2.6 \
     and 2.8. Less of it is less calm besides: after the usual number of strokes the median standard \
     error of L+ is 0.33 hundredths instead of 0.13.",
    "**A wing in its own wake must not see single lines.** With elevation amplitudes above 20° and short sweeps the \
     elevation, at twice the frequency, is the faster motion: the edge goes forward, and the wing lies in wake just shed, \
     whose core of some hundredths of a chord as the wing sees it is less than rows or panels lie apart. In solver_version 7 \
     stroke 48 of `studies/truth.toml` had L+ 0.88, 0.75 and 0.63 at elevation amplitudes of 24, 26 and 28°, with 102 steps \
     0.76, 0.34 and 0.41; stroke 33 had 0.80 instead of 0.94; random 17 had 0.77, but 0.64 with half the core of fresh wake, \
     as if there were two answers. Standard errors did not tell, and surrogates learnt such strokes badly. Now wake which \
     lies over the wing gains a core of 0.1 c (`core_over_wing`), and none behind the edge: stroke 48 has 0.87, 0.86 and 0.86, \
     with 102 steps 0.87 at all three, and random 17 has 0.78 with either core (`manduca simulate`). 0.03 c for all fresh wake \
     mends the same strokes, but a plate which oscillates at k = 2 then has some 3.7 % too much lift instead of 2.9, and \
     published lifts rise by 0.4 hundredths.",
    "**A core which develops in a quarter of a stroke is calmer and wrong.** In solver_version 7, with `core_growth_time` \
     0.25, halving all cores moved the means by 1.22, 0.81, 0.62 and 1.13 hundredths instead of 1.92, 1.40, 0.76 and 1.18, \
     and refinement by less too. But the near wake is then blurred as the wing sees it: lift of an oscillating plate is 2 \
     to 3 % too high at k = 0.2 to 0.5 instead of 1, lift after a sudden start 2.7 % instead of 1.4, published lifts rise \
     by two hundredths. \
     Smaller cores of fresh wake (0.0625 c, wake on wing 0.1 c, bound on wake 0.05 c) make them matter less again (0.51, \
     1.12, 0.39 and 0.82 when halved), but refinement then moves P+ by 2.4 hundredths instead of 1.7.",
    "**Refinement of everything tells less than the distance from a fine lattice.** More steps raise the power of violent \
     strokes, more panels along the chord lower it, and strips and steps have to grow together: strips much narrower than \
     a step, or steps much shorter than a strip, are worse than neither. 7 x 16 panels and 48 steps would pass for \
     converged: refinement moves their power by half of what it moves that of 8 x 10 and 64. Yet they are farther from a \
     fine lattice in everything, for they and their refinement both have too few steps. So meshes were \
     chosen by both: the default is nearer to the fine lattice than either. The finest one flown is no limit of the power \
     of violent strokes: there 96 steps and 144 still differ by more than one per cent of it, and no mesh a study could \
     afford is nearer than that.",
    "**Steps are dealt out by speed** (`steps_by_speed`): a wing which flips within a tenth of a stroke moves its edge \
     several times as far in a step as in between. Alone this changes little, with the newest wake in its place it \
     halves what is left.",
    "**Ends drawn in** by a sixth of the end strips (a quarter would suit uniform strips) remove most of the error of \
     ten strips along the span.",
    "**Power needs a finer clock than loads.** Where the wing flips within two steps, inertial power changes its sign \
     between them; sampled with the loads alone it is wrong by several per cent there. It is integrated with four \
     instants in every step, the air's moment interpolated.",
    "**Did not help:** rows of near wake within a step, implicitly solved (they halve the change with the time step in \
     violent strokes, but miss Theodorsen's lift at k = 1 and 2 by more and triple the change with strips); the newest \
     line at the present instead of the mean displacement (the lattice's influence on itself then changes in every step, \
     and the strokes no less with the steps); central differences for dΓ/dt two steps late, of second or fourth order \
     (exact for a plate in slow oscillation, no better for flips of a few steps); Richardson's extrapolation over \
     meshes with the same panels per step (two per cent of lift were left in strokes which answer by leaps).",
    "**A lattice which is exact where theory is does not fly better.** Panels and strips at equal angles of a \
     semicircle over chord and span (Lan 1974, J. Aircraft 11, 518) bring the steady lift slope within 0.3 % of its \
     limit with ten strips, where equal panels (8 x 10) were 2 % above it, and make the added mass of a two-dimensional \
     plate exact, where that of finite plates is 9 to 12 % too high on the default lattice. With it, and dΓ/dt from a \
     cubic through the impulse of the steps about each instant, 6 x 10 panels and 64 steps against 12 x 20 and 96 moved the 25 \
     strokes by 2.7, 2.6, 2.2 and 7.7 hundredths (panels alone 0.7, 0.3, 0.3 and 0.4; strips alone 1.0, 0.9, 0.5 \
     and 1.7; 96 steps alone 1.8, 1.4, 1.1 and 4.0). What is left is the time step's, which the errors of equal \
     panels hide by half.",
    "**What the time step still changes is the sheet of the step itself.** The newest line stands for an even sheet along \
     the chord, as long as a mean step. In a flip the edge moves across the chord and at another pace, and a sheet at an \
     angle φ to the chord does to a plate cos(φ/2) of what one along it does: an error of the root of the step. With the \
     lines moved by what the air at the edge did in the step (Adams and Bashforth's rule for all others), and the excess \
     of the newest line given to the next one, the circulation near the tip after a flip differs by 5 % between 64 and \
     144 steps, and not by 20 %; the angle had to count half, which has no derivation. Means of violent strokes then \
     move by half as much with the step, but one or two strokes in 25 become unstable where the edge moves forward over \
     its own wake, and refinement of everything gains nothing. dΓ/dt from three steps behind \
     (third order) is right at k = 2 and worse in flips of few steps.",
];

/// A flight of a stroke at some settings.
fn flight(parameters: &manduca_numerics::parameters::Point, settings: Settings) -> Flight {
    Flight { settings, ..Flight::of(*parameters) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effort_of_nothing_still_says_what_it_would_show() {
        let mut document = Document::new("x");
        introduction(&mut document, Effort { strokes: 0, errors: 0, lines: 0 });
        assert!(document.text().contains("wake_tail") && document.text().contains("strokes none"));
    }
}
