//! Ending work early that nobody waits for any longer.
//!
//! Work that may take long calls [`poll`] now and then, wherever it is. Around it, [`watch`] has
//! somebody asked every 50 ms, on the thread that called, whether to go on. If not, the next [`poll`]
//! on any of the work's threads unwinds, and `watch` returns. No function in between needs to know.
//!
//! Work that changes what stays behind is given some time to come to its end before it is stopped
//! half-way: see [`moving`].

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time between two questions.
const PERIOD: Duration = Duration::from_millis(50);

/// Time that moving work has to come to its end.
const GRACE: Duration = Duration::from_millis(500);

/// The work has been ended early. It is also what a stopped thread unwinds with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interrupted;

/// What a thread knows of the work that it is at.
#[derive(Clone, Copy)]
struct Place {
    /// Whether the work's threads shall stop; null where nobody watches.
    stop: *const AtomicBool,
    /// On the thread that called.
    watch: *const Watch<'static>,
}

struct Watch<'a> {
    /// Taken while it is asked.
    go_on: Cell<Option<&'a mut dyn FnMut() -> bool>>,
    asked: Cell<Instant>,
    /// When it said no.
    refused: Cell<Option<Instant>>,
    moving: Cell<bool>,
    stop: AtomicBool,
}

const NOWHERE: Place = Place {
    stop: std::ptr::null(),
    watch: std::ptr::null(),
};

thread_local! {
    static PLACE: Cell<Place> = const { Cell::new(NOWHERE) };
}

/// Puts the thread back where it was.
struct Return(Place);

impl Drop for Return {
    fn drop(&mut self) {
        PLACE.set(self.0);
    }
}

fn enter(place: Place) -> Return {
    Return(PLACE.replace(place))
}

/// Does `work`, and asks `go_on` every 50 ms on this thread whether to do so.
///
/// # Errors
/// The work has been ended early.
pub fn watch<R>(
    go_on: &mut dyn FnMut() -> bool,
    work: impl FnOnce() -> R,
) -> Result<R, Interrupted> {
    let watch = Watch {
        go_on: Cell::new(Some(go_on)),
        asked: Cell::new(Instant::now()),
        refused: Cell::new(None),
        moving: Cell::new(false),
        stop: AtomicBool::new(false),
    };
    let _return = enter(Place {
        stop: &raw const watch.stop,
        // only the lifetime changes; `_return` forgets it before `watch` ends
        watch: (&raw const watch).cast(),
    });
    unless_stopped(work)
}

/// Does `work`, which a [`poll`] may end.
fn unless_stopped<R>(work: impl FnOnce() -> R) -> Result<R, Interrupted> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| match panic.downcast::<Interrupted>() {
        Ok(interrupted) => *interrupted,
        Err(panic) => resume_unwind(panic),
    })
}

impl Watch<'_> {
    /// Asks if it is time to, and lets the work's threads stop if they shall.
    fn look(&self) {
        let refused = match self.refused.get() {
            Some(refused) => refused,
            None if self.asked.get().elapsed() < PERIOD => return,
            None => {
                // who is asked may do other work, which is watched on its own
                let Some(go_on) = self.go_on.take() else {
                    return;
                };
                let answer = go_on();
                self.go_on.set(Some(go_on));
                let now = Instant::now();
                self.asked.set(now);
                if answer {
                    return;
                }
                self.refused.set(Some(now));
                now
            }
        };
        if !self.moving.get() || refused.elapsed() >= GRACE {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// The watch of the work that this thread has called.
fn watch_here() -> Option<&'static Watch<'static>> {
    // SAFETY: it lives as long as the place is this thread's, and no borrow leaves this module's calls
    unsafe { PLACE.get().watch.as_ref() }
}

/// Whether the work shall stop. Asks if it is time to; does not unwind.
pub fn is_wanted() -> bool {
    if let Some(watch) = watch_here() {
        watch.look();
    }
    // SAFETY: it outlives the work, and with it every thread at the work
    unsafe { PLACE.get().stop.as_ref() }.is_some_and(|stop| stop.load(Ordering::Relaxed))
}

/// Unwinds if the work shall stop.
#[inline(never)]
pub fn poll() {
    if is_wanted() {
        resume_unwind(Box::new(Interrupted));
    }
}

/// Says whether what the calling thread does from now on would leave something half changed if it were
/// stopped. Such work is stopped only if it takes half a second more. Returns what held before.
pub fn moving(moving: bool) -> bool {
    watch_here().is_some_and(|watch| watch.moving.replace(moving))
}

/// Whether the work of the calling thread is moving.
pub fn is_moving() -> bool {
    watch_here().is_some_and(|watch| watch.moving.get())
}

/// Does something that changes nothing in the midst of work that does.
pub(crate) fn still<R>(work: impl FnOnce() -> R) -> R {
    let before = moving(false);
    let result = work();
    // where it is stopped nothing has been changed
    moving(before);
    result
}

/// The calling thread's flag, for the other threads at its work.
#[derive(Clone, Copy)]
pub(crate) struct Flag(*const AtomicBool);

// SAFETY: a flag is read alone, and outlives the work
unsafe impl Send for Flag {}
// SAFETY: as above
unsafe impl Sync for Flag {}

impl Flag {
    /// That of the work that this thread is at.
    pub(crate) fn here() -> Self {
        Self(PLACE.get().stop)
    }

    /// One that somebody else raises. It must outlive every use.
    pub(crate) fn of(stop: &AtomicBool) -> Self {
        Self(stop)
    }

    /// Does `work` on another thread, until the flag is raised.
    ///
    /// # Errors
    /// The work has been ended early.
    pub(crate) fn heed<R>(self, work: impl FnOnce() -> R) -> Result<R, Interrupted> {
        let _return = enter(Place {
            stop: self.0,
            watch: std::ptr::null(),
        });
        unless_stopped(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Polls until it is stopped; the time that took.
    fn stopped_after(move_on: bool) -> Duration {
        let begin = Instant::now();
        let result = watch(&mut || false, || {
            moving(move_on);
            loop {
                poll();
            }
        });
        assert_eq!(result, Err(Interrupted));
        begin.elapsed()
    }

    #[test]
    fn work_is_stopped_when_somebody_says_so() {
        assert!(stopped_after(false) < GRACE);
        poll();
    }

    #[test]
    fn moving_work_has_time_to_come_to_its_end() {
        assert!(stopped_after(true) >= GRACE);
        let result = watch(&mut || false, || {
            moving(true);
            let begin = Instant::now();
            while begin.elapsed() < 2 * PERIOD {
                poll();
            }
            1
        });
        assert_eq!(result, Ok(1));
    }

    #[test]
    fn other_panics_pass() {
        let result = catch_unwind(|| watch(&mut || true, || panic!("another")));
        assert!(!result.unwrap_err().is::<Interrupted>());
    }

    #[test]
    fn work_that_is_done_while_one_is_asked_is_watched_on_its_own() {
        let mut asked = 0;
        let mut ask = || {
            let inner = watch(&mut || true, || {
                poll();
                2
            });
            assert_eq!(inner, Ok(2));
            asked += 1;
            asked < 2
        };
        let result = watch(&mut ask, || {
            loop {
                poll();
            }
        });
        assert_eq!((result, asked), (Err::<(), _>(Interrupted), 2));
    }
}
