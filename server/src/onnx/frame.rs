//! What a frame does around the networks, as operators.

use manduca_numerics::parameters::at;
use manduca_numerics::surrogate::Frame;

use super::Graph;

/// What keeps the sharpness of a triangle finite, as in [`Frame::inputs`].
const BLUNT: f64 = 1.0 / 200.0;

impl Graph {
    /// What the networks are given of the parameters ([`Frame::inputs`]).
    pub(super) fn given(&mut self, frame: &Frame) -> String {
        let Frame::Physical { sharpness: true, .. } = frame else { return "parameters".into() };
        let before = self.columns("parameters", 0..at::SWEEP_SHAPE, "parameters.others");
        let (one, none) = (self.number("one", 1.0), self.number("none", 0.0));
        let k = self.column("parameters", at::SWEEP_SHAPE, "sweep_shape");
        let square = self.node("Mul", &[&k, &k], "sweep_shape.square", "");
        let less = self.node("Sub", &[&square, &one], "sweep_shape.less", "K² - 1");
        let left = self.node("Neg", &[&less], "sweep_shape.left", "");
        let left = self.node("Max", &[&left, &none], "sweep_shape.positive", "");
        let blunt = self.number("blunt", BLUNT);
        let left = self.node("Add", &[&left, &blunt], "sweep_shape.blunt", "");
        let left = self.node("Log", &[&left], "sweep_shape.logarithm", "");
        let kappa = self.node("Neg", &[&left], "sweep_sharpness", "-ln(1 - K² + 1/200)");
        let c = self.column("parameters", at::ROTATION_SHAPE, "rotation_shape");
        let square = self.node("Mul", &[&c, &c], "rotation_shape.square", "");
        let more = self.node("Add", &[&square, &one], "rotation_shape.more", "");
        let gamma = self.node("Log", &[&more], "rotation_sharpness", "ln(1 + C²)");
        self.node_by_columns("Concat", &[&before, &kappa, &gamma], "given")
    }

    /// From N, T, M about the hinge line and P at the reference frequency to L+, D+, M+, P+
    /// ([`Frame::outward`]).
    pub(super) fn outward(&mut self, learnt: &str, reference_hz: f64, arm: [f64; 2]) -> String {
        let f = self.column("parameters", at::FREQUENCY, "frequency");
        let reference = self.number("reference_hz", reference_hz);
        let r = self.node("Div", &[&f, &reference], "ratio", "f/f_r");
        let square = self.node("Mul", &[&r, &r], "ratio.square", "");
        let cube = self.node("Mul", &[&square, &r], "ratio.cube", "");
        let b = self.column("parameters", at::STROKE_PLANE, "stroke_plane");
        let degree = self.number("degree", 1_f64.to_radians());
        let b = self.node("Mul", &[&b, &degree], "stroke_plane.rad", "");
        let s = self.node("Sin", &[&b], "sine", "");
        // Not every runtime has a cosine of doubles.
        let quarter = self.number("quarter", std::f64::consts::FRAC_PI_2);
        let turned = self.node("Add", &[&b, &quarter], "stroke_plane.turned", "");
        let c = self.node("Sin", &[&turned], "cosine", "");
        let mut part = |k: usize, name: &str, factor: &str| {
            let at_reference = self.column(learnt, k, &format!("{name}.at_reference"));
            self.node("Mul", &[&at_reference, factor], name, "")
        };
        let (n, t) = (part(0, "normal", &square), part(1, "tangential", &square));
        let (hinge, power) = (part(2, "hinge_moment", &square), part(3, "power", &cube));
        let (x, z) = (self.number("arm.x", arm[0]), self.number("arm.z", arm[1]));
        let (xn, zt) = (self.node("Mul", &[&n, &x], "x.normal", ""), self.node("Mul", &[&t, &z], "z.tangential", ""));
        let shift = self.node("Sub", &[&xn, &zt], "moment.shift", "");
        let moment = self.node("Sub", &[&hinge, &shift], "pitch_moment", "M_h - (x N - z T)");
        let (nc, ts) = (self.node("Mul", &[&n, &c], "n.cos", ""), self.node("Mul", &[&t, &s], "t.sin", ""));
        let lift = self.node("Sub", &[&nc, &ts], "lift", "N cos b - T sin b");
        let (tc, ns) = (self.node("Mul", &[&t, &c], "t.cos", ""), self.node("Mul", &[&n, &s], "n.sin", ""));
        let forward = self.node("Add", &[&tc, &ns], "forward", "");
        let drag = self.node("Neg", &[&forward], "drag", "-(T cos b + N sin b)");
        self.node_by_columns("Concat", &[&lift, &drag, &moment, &power], "outward")
    }
}
