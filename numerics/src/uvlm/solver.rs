//! Time stepping of one wing, its mirror image and their wake.

use crate::kinematics::Vector;
use crate::uvlm::cores::Cores;
use crate::uvlm::geometry::{Flat, Lattice, Pose};
use crate::uvlm::influence::{Circulations, Matrix, RingInfluence};
use crate::uvlm::kernel::{Points, induce, interactions};
use crate::uvlm::loads::{Flow, WingLoad, wing_load};
use crate::uvlm::single::SingleWake;
use crate::uvlm::suction::SuctionFit;
use crate::uvlm::tail::Tail;
use crate::uvlm::wake::{Rings, Vorticity};

/// The air and the motion of the axes through it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// Density, kg/m³.
    pub density: f64,
    /// Velocity of the axes through the air, m/s; no component across the plane of symmetry.
    pub velocity: Vector,
    /// Angular velocity of the axes, rad/s, about the y axis only.
    pub omega: Vector,
    /// The point whose velocity is `velocity`, m.
    pub reference: Vector,
}

impl Air {
    /// Still air seen from axes at rest.
    pub fn still(density: f64) -> Self {
        Self { density, velocity: Vector::zeros(), omega: Vector::zeros(), reference: Vector::zeros() }
    }

    /// Velocity of a point of the axes through the air, m/s.
    pub fn carried(&self, p: &Vector) -> Vector {
        self.velocity + self.omega.cross(&(p - self.reference))
    }
}

/// What becomes of the leading-edge suction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suction {
    /// Share turned into vortex lift normal to the wing.
    pub to_lift: f64,
    /// Share kept in the wing's plane, pulling forward.
    pub in_plane: f64,
}

/// A wing in flight.
#[derive(Debug, Clone)]
pub struct Solver {
    lattice: Lattice,
    air: Air,
    cores: Cores,
    suction: Suction,
    fit: SuctionFit,
    vorticity: Vorticity,
    /// Age in steps at which wake is forgotten.
    kept: usize,
    /// Age from which rows of wake are joined and length of a stroke, steps; see `joining_after`.
    joined: Option<(usize, usize)>,
    tail: Option<Tail>,
    single: bool,
    circulations: Circulations,
    rhs: Vec<f64>,
    /// Circulations of this step and the two before, newest first.
    history: [Vec<f64>; 3],
    /// Time since the first step, s, and how long this step and the one before were.
    time: f64,
    last: [f64; 2],
    rate: Vec<f64>,
    steps: usize,
    edge: Edge,
    /// Collocation points, their mirror images, then the bound segments' middles.
    near: Points,
    near_velocity: Points,
    /// Mirror images of the collocation points alone, then of the bound segments' middles.
    images: Points,
    image: Points,
    image_velocity: Points,
    wake_targets: Points,
    wake_velocity: Points,
    single_wake: SingleWake,
    relative: Vec<Vector>,
    interactions: u64,
}

/// The trailing edge, for the wake that leaves it.
#[derive(Debug, Clone, Default)]
struct Edge {
    /// Where the air is now that was at the edge a step ago, but for what the vortices did to it.
    before: Vec<Vector>,
    /// The middle between that and the edge: of the sheet shed in the step.
    middle: Vec<Vector>,
}

/// Mirror in the plane of symmetry.
fn mirrored(p: [f64; 3]) -> [f64; 3] {
    [p[0], -p[1], p[2]]
}

/// Influence of a rigid lattice on itself, towards its lifting side.
fn own_influence(lattice: &Lattice, core: f64) -> Matrix {
    let count = lattice.panels.len();
    let mut own = Matrix::zeros(count, count);
    let mut targets = Points::zeros(count);
    for (i, panel) in lattice.panels.iter().enumerate() {
        targets.set(i, [panel.collocation.x, panel.collocation.y, 0.0]);
    }
    let component = |f: &dyn Fn(usize) -> f64| (0..lattice.nodes.len()).map(f).collect::<Vec<_>>();
    let (r, s, n) = (component(&|i| lattice.nodes[i].x), component(&|i| lattice.nodes[i].y), component(&|_| 0.0));
    // In (e_r, e_c, e_n) axes the lifting side is -e_n.
    let direction = [0.0, 0.0, -1.0];
    RingInfluence { nodes: [&r, &s, &n], columns: lattice.columns(), core, targets: &targets, direction }
        .fill(&mut own);
    own
}

impl Solver {
    /// A wing at rest in air at rest, which remembers `kept` steps of wake.
    ///
    /// # Panics
    /// When the lattice's influence on itself is singular: strips without width.
    pub fn new(lattice: Lattice, air: Air, cores: Cores, suction: Suction, kept: usize) -> Self {
        let count = lattice.panels.len();
        let rows = kept.max(1) + 1;
        let circulations = Circulations::new(own_influence(&lattice, cores.bound)).expect("a lattice of real panels");
        let targets = 2 * (rows + 1) * lattice.columns();
        Self {
            vorticity: Vorticity::new(lattice.columns(), lattice.chordwise + 1, rows),
            kept: kept.max(1),
            joined: None,
            tail: None,
            single: false,
            fit: SuctionFit::new(lattice.chordwise),
            circulations,
            rhs: vec![0.0; count],
            history: [vec![0.0; count], vec![0.0; count], vec![0.0; count]],
            time: 0.0,
            last: [0.0; 2],
            rate: vec![0.0; count],
            steps: 0,
            edge: Edge::default(),
            near: Points::zeros(3 * count),
            near_velocity: Points::zeros(3 * count),
            images: Points::zeros(count),
            image: Points::zeros(count),
            image_velocity: Points::zeros(count),
            wake_targets: Points::zeros(targets),
            wake_velocity: Points::zeros(targets),
            single_wake: SingleWake::default(),
            relative: vec![Vector::zeros(); count],
            interactions: 0,
            lattice,
            air,
            cores,
            suction,
        }
    }

    /// Joins every other row of wake older than `age` steps to its neighbour, every other of those left
    /// when they are four times as old, and so on: rows lie apart by the root of their age, as wide as
    /// their cores have spread. Every stroke of `period` steps keeps the same rows.
    pub fn joining_after(mut self, age: usize, period: usize) -> Self {
        self.joined = Some((age.max(2), period.max(1)));
        self
    }

    /// Continues the wake beyond the one remembered by sinks, for strokes of
    /// `period` steps, spread over `radius`, m.
    pub fn with_tail(mut self, period: usize, radius: f64) -> Self {
        self.tail = Some(Tail::new(period, radius));
        self
    }

    /// Computes the velocity of the wake's nodes in single precision.
    pub fn single_precision_wake(mut self) -> Self {
        self.single = true;
        self
    }

    /// One time step: the wing at `pose`, `dt` after the step before. Returns the
    /// load on this wing; the other's is its mirror image. `None` when the lattice
    /// has lost its numbers.
    pub fn step(&mut self, pose: &Pose, dt: f64) -> Option<WingLoad> {
        if self.steps > 0 {
            self.forget();
            self.convect(dt);
            self.vorticity.shed(self.steps - 1, self.time);
            if let Some((age, period)) = self.joined {
                self.vorticity.join_old(self.steps, age, period);
            }
            self.time += dt;
            self.last = [dt, self.last[0]];
        }
        self.place(pose);
        self.place_edge(pose, dt);
        self.wake_on_wing(pose);
        self.solve(pose)?;
        self.vorticity.set_bound(&self.history[0]);
        self.vorticity.assemble_bound();
        self.relative_flow(pose);
        self.differentiate();
        let flow = Flow { circulation: &self.history[0], rate: &self.rate, relative: &self.relative };
        let load = wing_load(&self.lattice, pose, &self.air, &self.suction, &self.fit, &flow);
        self.steps += 1;
        load.force.iter().chain(load.moment.iter()).all(|x| x.is_finite()).then_some(load)
    }

    /// Circulations of the last step, front row first, m²/s.
    pub fn circulation(&self) -> &[f64] {
        &self.history[0]
    }

    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The rings of wing and wake as they were when the last step's loads were taken.
    pub fn rings(&self) -> Rings<'_> {
        self.vorticity.rings()
    }

    /// Segment-on-point evaluations so far.
    pub fn interactions(&self) -> u64 {
        self.interactions
    }

    /// Forgets the row of wake which would grow too old in this step.
    fn forget(&mut self) {
        let now = self.steps - 1;
        if let Some(tail) = &mut self.tail {
            tail.watch(&self.vorticity, now, self.kept);
        }
        if self.vorticity.outlives(now, self.kept) {
            self.vorticity.forget();
        }
    }

    /// Puts the wing's nodes and the points where it is looked at in space.
    fn place(&mut self, pose: &Pose) {
        let count = self.lattice.panels.len();
        for (i, node) in self.lattice.nodes.iter().enumerate() {
            self.vorticity.set_node(i, pose.place(node).into());
        }
        for (i, panel) in self.lattice.panels.iter().enumerate() {
            let (collocation, bound) = (pose.place(&panel.collocation).into(), pose.place(&panel.bound).into());
            self.near.set(i, collocation);
            self.near.set(count + i, mirrored(collocation));
            self.near.set(2 * count + i, bound);
            self.images.set(i, mirrored(collocation));
            self.image.set(i, mirrored(bound));
        }
    }

    /// Follows the trailing edge. In the first step the wing starts from where it is.
    fn place_edge(&mut self, pose: &Pose, dt: f64) {
        let Edge { before, middle } = &mut self.edge;
        let started = !before.is_empty();
        before.resize(self.lattice.trailing.len(), Vector::zeros());
        middle.resize(before.len(), Vector::zeros());
        for ((p, before), middle) in self.lattice.trailing.iter().zip(before).zip(middle) {
            let now = pose.place(p);
            let left = if started { *before - self.air.carried(before) * dt } else { now };
            (*before, *middle) = (now, (now + left) * 0.5);
        }
    }

    /// Velocity of the wake alone at collocation points, their images and bound segments.
    fn wake_on_wing(&mut self, pose: &Pose) {
        self.vorticity.clear_bound();
        let cores = self.cores;
        let by_age = |age: f64| if age <= 0.0 { cores.bound } else { cores.on_wing(age) };
        let normal = pose.normal();
        let over = |p: [f64; 3]| {
            let from = Vector::from(p) - pose.origin;
            let flat = || Flat::new(from.dot(&pose.e_r), from.dot(&pose.e_c));
            cores.over_wing2(from.dot(&normal), || self.lattice.ahead_of_edge(&flat()))
        };
        // It acts on the other wing too, this one's image; what lies over one is far from the other.
        let by_place = |p: [f64; 3]| over(p) + over(mirrored(p));
        self.vorticity.assemble(self.time, by_age, by_place);
        self.near_velocity.clear();
        if let Some(wake) = self.vorticity.wake() {
            induce(&wake, &self.near, &mut self.near_velocity);
            self.interactions += interactions(&wake, &self.near);
        }
        if let Some(tail) = &self.tail {
            tail.induce(&self.near, &mut self.near_velocity);
        }
    }

    /// Velocity of the axes plus that of the wing within them.
    fn through_air(&self, pose: &Pose, p: &nalgebra::Vector2<f64>) -> Vector {
        pose.velocity_of(p) + self.air.carried(&pose.place(p))
    }

    /// No flow through the wing at the collocation points. The new circulations are
    /// the newest in the history; those of the step before are their first guess.
    fn solve(&mut self, pose: &Pose) -> Option<()> {
        let count = self.lattice.panels.len();
        let normal = pose.normal();
        for i in 0..count {
            let wake =
                Vector::from(self.near_velocity.get(i)) + Vector::from(mirrored(self.near_velocity.get(count + i)));
            self.rhs[i] = (self.through_air(pose, &self.lattice.panels[i].collocation) - wake).dot(&normal);
        }
        // The image wing's velocity at P is the mirror image of this wing's at P's image.
        let image = RingInfluence {
            nodes: self.vorticity.wing_nodes(),
            columns: self.lattice.columns(),
            core: self.cores.bound,
            targets: &self.images,
            direction: mirrored(normal.into()),
        };
        image.fill(&mut self.circulations.image);
        self.interactions += (count * (2 * count + self.lattice.chordwise + self.lattice.strips)) as u64;
        self.history.rotate_right(1);
        let [now, before, _] = &mut self.history;
        now.copy_from_slice(before);
        self.circulations.solve(&self.rhs, now)
    }

    /// Air relative to the bound segments: wake, image wing and its wake, less the wing's motion.
    fn relative_flow(&mut self, pose: &Pose) {
        // The cores are still those the wing sees: no node has moved since the wake's share was taken.
        let all = self.vorticity.all();
        self.image_velocity.clear();
        induce(&all, &self.image, &mut self.image_velocity);
        self.interactions += interactions(&all, &self.image);
        if let Some(tail) = &self.tail {
            tail.induce(&self.image, &mut self.image_velocity);
        }
        let count = self.lattice.panels.len();
        for i in 0..count {
            let induced = Vector::from(self.near_velocity.get(2 * count + i))
                + Vector::from(mirrored(self.image_velocity.get(i)));
            self.relative[i] = induced - self.through_air(pose, &self.lattice.panels[i].bound);
        }
    }

    /// dΓ/dt by backward differences over steps of any length, second order once there are
    /// two steps behind.
    fn differentiate(&mut self) {
        let [now, before, earlier] = &self.history;
        let [h, g] = self.last;
        // The parabola's slope at its end: 3/2, -2 and 1/2 for equal steps.
        let (a, b, c) = ((2.0 * h + g) / (h * (h + g)), -(h + g) / (h * g), h / (g * (h + g)));
        for (i, rate) in self.rate.iter_mut().enumerate() {
            *rate = match self.steps {
                0 => 0.0,
                1 => (now[i] - before[i]) / h,
                _ => a * now[i] + b * before[i] + c * earlier[i],
            };
        }
    }

    /// Moves the wake with the air (explicit Euler). The newest line of nodes starts from the
    /// middle of the sheet it stands for; at the edge it was where it acts like that sheet.
    fn convect(&mut self, dt: f64) {
        let cores = self.cores;
        // On the line at the edge both sheets meet: it has the wake's core for both.
        let by_age = |age: f64| if age < 0.0 { cores.bound_on_wake } else { cores.on_wake(age) };
        self.vorticity.assemble(self.time, by_age, |_| 0.0);
        let nodes = self.vorticity.convected();
        let moved = nodes.len();
        self.wake_targets.resize(2 * moved);
        self.wake_velocity.resize(2 * moved);
        self.wake_velocity.clear();
        for (i, node) in nodes.clone().enumerate() {
            let p = self.vorticity.node(node);
            self.wake_targets.set(i, p);
            self.wake_targets.set(moved + i, mirrored(p));
        }
        let all = self.vorticity.all();
        if self.single {
            self.single_wake.induce(&all, &self.wake_targets, &mut self.wake_velocity);
        } else {
            induce(&all, &self.wake_targets, &mut self.wake_velocity);
        }
        self.interactions += interactions(&all, &self.wake_targets);
        if let Some(tail) = &self.tail {
            tail.induce(&self.wake_targets, &mut self.wake_velocity);
        }
        for (i, node) in nodes.enumerate() {
            let p = self.edge.middle.get(i).copied().unwrap_or_else(|| self.wake_targets.get(i).into());
            let v = Vector::from(self.wake_velocity.get(i)) + Vector::from(mirrored(self.wake_velocity.get(moved + i)));
            self.vorticity.set_node(node, (p + (v - self.air.carried(&p)) * dt).into());
        }
    }
}
