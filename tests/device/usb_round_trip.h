// How long a packet and its reply take over the real libusb and a pretended Falcon, and how many are lost.
#pragma once

#include <cstdint>
#include <string>

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

struct RoundTripOptions {
  double seconds = 60.0;
  bool event_character = false;
  bool real_time = false;  ///< asks for SCHED_FIFO, for the loop, the link and what pretends to be a device
};
/// One packet a millisecond, each answered by one that holds its number.
[[nodiscard]] RoundTrips measure_round_trips(const RoundTripOptions& options);

}  // namespace palpate::device
