//! Work on other threads, while this one listens to Ctrl-C and tells the caller's progress.

use super::errors::to_py;
use crate::backend::{Control, cpu};
use crate::error::{Error, Result};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPool;
use std::cell::OnceCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

/// How often this thread looks up.
const TICK: Duration = Duration::from_millis(50);

/// The threads of one call, started with its first work; the interpreter's own thread only listens.
pub struct Threads {
    count: Option<usize>,
    pool: OnceCell<ThreadPool>,
}

impl Threads {
    /// So many, `None` for one on each core.
    pub fn new(count: Option<usize>) -> Self {
        Threads { count, pool: OnceCell::new() }
    }

    fn pool(&self) -> Result<&ThreadPool> {
        match self.pool.get() {
            Some(pool) => Ok(pool),
            None => cpu::pool(self.count).map(|pool| self.pool.get_or_init(|| pool)),
        }
    }

    /// Does `work` with the interpreter released. A signal's exception is passed on when it is done.
    pub fn run<T: Send>(&self, py: Python<'_>, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
        self.watch(py, None, None, |_| work())
    }

    /// Does `work` with the interpreter released. A signal's exception, or one that `progress` raises, stops the work and is
    /// passed on; `progress` may return False to stop it and keep what there is. A panic becomes an error.
    pub fn watch<T: Send>(
        &self,
        py: Python<'_>,
        time_limit: Option<f64>,
        progress: Option<&Bound<'_, PyAny>>,
        work: impl FnOnce(&Control) -> Result<T> + Send,
    ) -> PyResult<T> {
        let pool = self.pool().map_err(|e| to_py(py, e))?;
        let control = Control::new(time_limit);
        let (send, receive) = sync_channel(1);
        let (outcome, interruption) = pool.in_place_scope(|scope| {
            let control = &control;
            scope.spawn(move |_| {
                let done = catch_unwind(AssertUnwindSafe(|| work(control)));
                // The receiver lives until this message is there; a failure to send has no one to tell.
                drop(send.send(done));
            });
            let receive = Mutex::new(receive);
            let mut interruption: Option<PyErr> = None;
            loop {
                let message = py.detach(|| match receive.lock() {
                    Ok(receive) => receive.recv_timeout(TICK),
                    Err(_) => Err(RecvTimeoutError::Disconnected),
                });
                match message {
                    Ok(done) => return (Some(done), interruption),
                    Err(RecvTimeoutError::Disconnected) => return (None, interruption),
                    Err(RecvTimeoutError::Timeout) if interruption.is_none() => {
                        if let Err(error) = py.check_signals().and_then(|()| tell(py, progress, control)) {
                            interruption = Some(error);
                            control.stop();
                        }
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        });
        if let Some(error) = interruption {
            return Err(error);
        }
        match outcome {
            Some(Ok(Ok(value))) => Ok(value),
            Some(Ok(Err(error))) => Err(to_py(py, error)),
            Some(Err(panic)) => {
                let text = panic.downcast_ref::<String>().cloned();
                let text = text.or_else(|| panic.downcast_ref::<&str>().map(ToString::to_string)).unwrap_or_default();
                Err(to_py(py, Error::Internal(format!("a bug in mcrt stopped the run: {text}"))))
            }
            None => Err(to_py(py, Error::Internal("the worker thread ended without a result".into()))),
        }
    }
}

fn tell(py: Python<'_>, progress: Option<&Bound<'_, PyAny>>, control: &Control) -> PyResult<()> {
    if let Some(progress) = progress {
        let (fraction, photons) = control.progress();
        let info = PyDict::new(py);
        info.set_item("photons", photons)?;
        info.set_item("seconds", control.seconds())?;
        let answer = progress.call1((fraction, info))?;
        if answer.extract::<bool>().is_ok_and(|go_on| !go_on) {
            control.finish();
        }
    }
    Ok(())
}
