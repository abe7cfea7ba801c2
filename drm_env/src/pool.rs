//! Threads that share out work.

use std::sync::{Mutex, PoisonError};

/// Threads, made at the first call that needs them and again in a forked process, which inherits
/// none.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    made: Option<(u32, usize, rayon::ThreadPool)>,
}

impl Pool {
    /// The threads beside the calling one, or none if the system gives none.
    fn helpers(&mut self, count: usize) -> Option<&rayon::ThreadPool> {
        let process = std::process::id();
        if self
            .made
            .as_ref()
            .is_none_or(|(maker, made, _)| *maker != process || *made != count)
        {
            if let Some((maker, _, inherited)) = self.made.take()
                && maker != process
            {
                // joining threads that exist in the parent alone would hang
                std::mem::forget(inherited);
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
            self.made = pool.ok().map(|pool| (process, count, pool));
        }
        self.made.as_ref().map(|(_, _, pool)| pool)
    }

    /// Does `work` on every part: each of so many threads, the calling one among them, takes the next
    /// part when it is free.
    pub(crate) fn share<P: Send>(
        &mut self,
        threads: usize,
        parts: impl Iterator<Item = P> + Send,
        work: impl Fn(P) + Sync,
    ) {
        let queue = Mutex::new(parts);
        let take = || {
            let mut queue = queue.lock().unwrap_or_else(PoisonError::into_inner);
            queue.next()
        };
        let run = || {
            while let Some(part) = take() {
                work(part);
            }
        };
        match self.helpers(threads.saturating_sub(1).max(1)) {
            Some(pool) if threads > 1 => pool.in_place_scope(|scope| {
                for _ in 1..threads {
                    scope.spawn(|_| run());
                }
                run();
            }),
            _ => run(),
        }
    }
}
