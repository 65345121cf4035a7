//! A time step allocates nothing once the wake is as long as it is remembered.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

use manduca_numerics::cases::CASES;
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::ElevationPhase;
use manduca_numerics::simulation::{BodyVelocity, Model, Simulation, simulate_watched};
use manduca_numerics::uvlm::Settings;

/// The system's allocator, counting.
struct Counting;

static COUNT: AtomicU64 = AtomicU64::new(0);

// SAFETY: every call goes to the system's allocator as it came.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing() {
    let settings = Settings {
        chordwise_panels: 3,
        spanwise_panels: 5,
        steps_per_stroke: 16,
        strokes: 7,
        strokes_most: 7,
        ..Settings::default()
    };
    let simulation = Simulation {
        model: Model::Uvlm(settings),
        insect: Insect::default(),
        parameters: CASES[2].parameters,
        elevation_phase: ElevationPhase::Plus,
        elastic_storage: 0.0,
        body_velocity: BodyVelocity::default(),
    };
    // Allocations between steps of a stroke; between strokes the means are looked at.
    let (mut before, mut in_late_strokes, mut in_first) = (0, 0, 0);
    let flown = simulate_watched(&simulation, &mut |moment, _| {
        let now = COUNT.load(Ordering::Relaxed);
        if moment.step > 0 {
            if moment.stroke > 4 {
                in_late_strokes += now - before;
            } else if moment.stroke == 1 {
                in_first += now - before;
            }
        }
        before = now;
    });
    assert!(flown.is_ok());
    assert_eq!(in_late_strokes, 0);
    // The counter counts: while the wake grows, so do the arrays of its single-precision copy.
    assert!(in_first > 0);
}
