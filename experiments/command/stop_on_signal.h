// How the command ends when it is told to stop.
#pragma once

namespace palpate::experiments {

/// From here on SIGINT, SIGTERM and SIGHUP end the program at once, whatever it is doing: the actions of
/// toolkit/core/at_stop.h are run, what they say goes to standard error, and the exit status is 128 + signal
/// (130, 143, 129). A second signal, later, does not even wait for these. SIGPIPE is
/// ignored: what nobody reads is told by the write, and messages are no reason to end. To be called once,
/// first of all.
void stop_on_signals();

}  // namespace palpate::experiments
