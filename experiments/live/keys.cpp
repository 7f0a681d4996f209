#include "experiments/live/keys.h"

#include <poll.h>
#include <termios.h>
#include <unistd.h>

namespace palpate::experiments {
namespace {

termios terminal_before;

}  // namespace

Keys::Keys() {
  if (isatty(STDIN_FILENO) == 0 || tcgetattr(STDIN_FILENO, &terminal_before) != 0) return;
  termios raw = terminal_before;
  raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  stop_callback_ = StopCallback([this] {
    give_back();
    return std::string();
  });
  raw_ = tcsetattr(STDIN_FILENO, TCSANOW, &raw) == 0;
}

Keys::~Keys() {
  stop_callback_.drop();
  give_back();
}

void Keys::give_back() noexcept {
  if (raw_) tcsetattr(STDIN_FILENO, TCSANOW, &terminal_before);
}

std::optional<char> Keys::next() {
  if (!raw_) return std::nullopt;
  pollfd input{STDIN_FILENO, POLLIN, 0};
  char key = 0;
  if (poll(&input, 1, 0) <= 0 || read(STDIN_FILENO, &key, 1) != 1) return std::nullopt;
  return key;
}

}  // namespace palpate::experiments
