// The palpate program: runs the command line, and turns whatever is thrown into an exit status.
#include <fcntl.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <system_error>

#include "experiments/command/cli.h"
#include "toolkit/core/messages.h"

namespace {

/// Standard streams that are closed would be the next files that are opened, and results, messages and data
/// would mix. The streams put in their place refuse to be written.
void hold_standard_streams() {
  for (const int stream : {0, 1, 2})
    if (::fcntl(stream, F_GETFD) < 0 && ::openat(AT_FDCWD, "/dev/null", O_RDONLY) != stream) return;
}

/// Results that nobody reads any more end the program without a word, as any command at the head of a pipe.
void end_by_pipe() {
  std::signal(SIGPIPE, SIG_DFL);
  (void)std::raise(SIGPIPE);
}

}  // namespace

int main(int argc, char** argv) {
  hold_standard_streams();
  try {
    palpate::experiments::stop_on_signals();
    const int status = palpate::experiments::run_command_line(argc, argv);
    // Text that did not fit into the buffer failed before.
    if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return status;
    if (errno == EPIPE) end_by_pipe();
    palpate::tell("palpate: error: standard output cannot be written: {}\n", std::strerror(errno));
  } catch (const std::bad_alloc&) {
    palpate::tell("palpate: error: out of memory; close other programs or take a smaller model\n");
  } catch (const std::system_error& error) {
    if (error.code().value() == EPIPE) end_by_pipe();
    palpate::tell("palpate: error: {}; is the disk full, or the output closed?\n", error.what());
  } catch (const std::exception& error) {
    palpate::tell("palpate: error: unexpected: {}; this is a fault of Palpate, please report it\n",
                  error.what());
  }
  return palpate::experiments::kExitFellShort;
}
