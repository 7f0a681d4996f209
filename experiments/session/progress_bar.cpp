#include "experiments/session/progress_bar.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include <palpate/clock.h>
#include "experiments/session/terminal.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr std::int64_t kSilentNs = 1'000'000'000;  // shorter work needs no bar
constexpr std::int64_t kRedrawNs = 100'000'000;    // ten times a second
constexpr std::int64_t kLogNs = 5'000'000'000;     // a line of a log stands for so long
constexpr double kBelievableFraction = 0.02;       // before that a time left would only jump about
constexpr int kBarCells = 24;

std::string seconds(double s) {
  constexpr int kMinute = 60;
  const int whole = static_cast<int>(s + 0.5);
  return whole < kMinute ? fmt::format("{} s", whole)
                         : fmt::format("{} min {:02} s", whole / kMinute, whole % kMinute);
}

}  // namespace

ProgressBar::ProgressBar() : terminal_(::isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  clear();
}

void ProgressBar::clear() {
  if (drawn_) std::fputs("\r\033[K", stderr);
  drawn_ = false;
}

void ProgressBar::report(std::string_view what, double fraction) {
  const std::int64_t now = monotonic_ns();
  if (!terminal_) {
    // A log gets a plain line now and then, so that a long job is not taken for a dead one.
    if (prefix_.empty() || now - last_draw_ns_ < kLogNs || phase_ == what) return;
    last_draw_ns_ = now;
    phase_ = what;
    tell("{}{}\n", prefix_, phase_);
    return;
  }
  if (phase_ != what) {
    phase_ = what;
    // A phase whose text changes with every report ("12.3 MB") goes on from where it began.
    if (fraction >= 0.0 || phase_start_ns_ == 0) phase_start_ns_ = now;
  }
  if (now - phase_start_ns_ < kSilentNs || now - last_draw_ns_ < kRedrawNs) return;
  last_draw_ns_ = now;
  const double elapsed_s = static_cast<double>(now - phase_start_ns_) * 1e-9;
  std::string line = prefix_ + phase_;
  if (fraction >= 0.0) {
    const double f = std::clamp(fraction, 0.0, 1.0);
    const auto filled = static_cast<std::size_t>(f * kBarCells);
    line += fmt::format("  [{}{}] {:3.0f} %", std::string(filled, '#'), std::string(kBarCells - filled, '.'),
                        100.0 * f);
    if (f > kBelievableFraction) line += fmt::format("  {} left", seconds(elapsed_s * (1.0 - f) / f));
  } else {
    line += fmt::format("  {}", seconds(elapsed_s));
  }
  tell("\r\033[K{}", line.substr(0, terminal_columns(STDERR_FILENO) - 1));
  std::fflush(stderr);
  drawn_ = true;
}

}  // namespace palpate::experiments
