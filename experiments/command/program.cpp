// The palpate program: runs the command line, and turns whatever is thrown into an exit status.
#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <system_error>

#include "experiments/command/command_line.h"
#include "experiments/command/stop_on_signal.h"

int main(int argc, char** argv) {
  try {
    palpate::experiments::stop_on_signals();
    const int status = palpate::experiments::run_command_line(argc, argv);
    if (std::fflush(stdout) == 0) return status;
    fmt::print(stderr, "palpate: error: standard output cannot be written: {}\n", std::strerror(errno));
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "palpate: error: out of memory; close other programs or take a smaller model\n");
  } catch (const std::system_error& error) {
    fmt::print(stderr, "palpate: error: {}; is the disk full, or the output closed?\n", error.what());
  } catch (const std::exception& error) {
    fmt::print(stderr, "palpate: error: unexpected: {}; this is a fault of Palpate, please report it\n",
               error.what());
  }
  return palpate::experiments::kExitFellShort;
}
