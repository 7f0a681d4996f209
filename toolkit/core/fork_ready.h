// What must be so before a process is forked that is to go on working, not to start another program.
#pragma once

namespace palpate {

/// Ends the threads that parallel work has left waiting: a forked process has only the thread that forked,
/// and would wait for the others for ever. They come again with the next work. False where some are at work
/// still, or where this build cannot be forked (ThreadSanitizer).
[[nodiscard]] bool end_waiting_threads();

}  // namespace palpate
