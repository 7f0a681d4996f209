// How long a command and its answer take over a real link and a pretended board, and how many are lost.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <palpate/device/link.h>

namespace palpate::device {

struct RoundTrips {
  std::uint64_t sent = 0;  ///< one in each tick
  std::uint64_t answered = 0;
  std::uint64_t overtaken = 0;  ///< by a newer one, the device being slower than the ticks: never went out
  std::uint64_t refused = 0;    ///< by the link
  std::uint64_t lost = 0;       ///< went out, and no answer came
  std::uint64_t malformed = 0, overrun = 0;
  std::uint64_t late_ticks = 0;  ///< of the loop itself, by over a period
  double p50_ms = 0.0, p99_ms = 0.0, p999_ms = 0.0, most_ms = 0.0;
  double seconds = 0.0;
  bool fifo = false;  ///< SCHED_FIFO was obtained

  [[nodiscard]] std::string json(const std::string& path) const;
};

/// Commands that hold a number, and the answers that hold it too.
struct TripProtocol {
  std::uint32_t numbers;  ///< they begin anew after so many; more than can be under way
  std::function<std::vector<std::uint8_t>(std::uint32_t number)> command;
  /// Calls `answered` with each number in what one poll gave, also when torn and glued.
  std::function<void(std::span<const std::uint8_t> polled,
                     const std::function<void(std::uint32_t number)>& answered)>
      take;
  std::function<std::uint64_t()> overtaken;  ///< commands that a newer one replaced so far
};
/// A board that gives back what it is sent: 16 bytes, a mark and a number.
[[nodiscard]] TripProtocol echo_protocol(std::function<std::uint64_t()> overtaken);

/// One command a millisecond over an open link. At the end it waits for the answers of all that were not
/// overtaken, and gives up after 20 s.
[[nodiscard]] RoundTrips measure_round_trips(Link& link, double seconds, const TripProtocol& protocol);

}  // namespace palpate::device
