// How long a command and its answer take over a real link and a pretended board, and how many are lost.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "device/interface/link.h"

namespace palpate::device {

struct LinkTrips {
  std::uint64_t sent = 0, answered = 0, refused = 0;
  std::uint64_t lost = 0;        ///< sent and not answered
  std::uint64_t replaced = 0;    ///< of these: overtaken by a newer one before they were written
  std::uint64_t late_ticks = 0;  ///< of the loop itself, by over a period
  double seconds = 0.0, p50_ms = 0.0, p99_ms = 0.0, p999_ms = 0.0, most_ms = 0.0;

  [[nodiscard]] std::string json(const std::string& path) const;
};

/// One command a millisecond over an open link, each answered by a message of the same 16 bytes: the board is
/// an echo. `numbered`: those bytes follow a report's number.
/// `replaced` tells how many a newer one overtook so far: at the end it waits for the answers of all others,
/// and gives up after kTripPatienceS.
[[nodiscard]] LinkTrips measure_link_trips(Link& link, double seconds,
                                           const std::function<std::uint64_t()>& replaced);
inline constexpr double kTripPatienceS = 20.0;

}  // namespace palpate::device
