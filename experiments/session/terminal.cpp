#include "experiments/session/terminal.h"

#include <sys/ioctl.h>

#include <charconv>
#include <cstdlib>
#include <string_view>

namespace palpate::experiments {

std::size_t terminal_columns(int descriptor) {
  constexpr std::size_t kDefault = 80, kMost = 10'000;
  if (const char* const set = std::getenv("COLUMNS"); set != nullptr) {
    const std::string_view text(set);
    std::size_t columns = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), columns);
    if (error == std::errc() && end == text.data() + text.size() && columns > 0 && columns <= kMost)
      return columns;
  }
  winsize size{};
  if (::ioctl(descriptor, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  return kDefault;
}

}  // namespace palpate::experiments
