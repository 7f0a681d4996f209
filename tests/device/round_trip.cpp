#include "tests/device/round_trip.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <utility>

#include <palpate/clock.h>

namespace palpate::device {
namespace {

constexpr std::int64_t kTripPeriodNs = 1'000'000;
constexpr timespec kBetweenPolls{0, 20'000};
constexpr double kTripPatienceMs = 20'000.0;

double share_of(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0.0;
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5)];
}

/// Sends and listens.
class TripMeter {
 public:
  TripMeter(Link& link, const TripProtocol& protocol)
      : link_(link),
        protocol_(protocol),
        overtaken_before_(protocol.overtaken()),
        sent_ns_(protocol.numbers, 0) {}

  void send() {
    const auto number = static_cast<std::uint32_t>(trips.sent++ % protocol_.numbers);
    if (sent_ns_[number] != 0) ++trips.lost;  // never answered, a round ago
    sent_ns_[number] = monotonic_ns();
    if (link_.submit(protocol_.command(number))) return;
    ++trips.refused;
    sent_ns_[number] = 0;
  }
  void listen_until(std::int64_t until_ns) {
    do {
      std::array<std::uint8_t, 65> bytes;
      for (Polled polled = link_.poll(bytes); polled.size > 0; polled = link_.poll(bytes))
        protocol_.take(std::span(bytes).first(polled.size),
                       [this](std::uint32_t number) { answered(number); });
      ::nanosleep(&kBetweenPolls, nullptr);
    } while (monotonic_ns() < until_ns);
  }
  [[nodiscard]] std::uint64_t overtaken() const { return protocol_.overtaken() - overtaken_before_; }
  /// Neither answered nor overtaken until now.
  [[nodiscard]] bool are_under_way() const {
    return trips.answered + trips.refused + overtaken() < trips.sent;
  }
  RoundTrips finished() {
    for (const std::int64_t sent : sent_ns_) trips.lost += sent != 0 ? 1 : 0;
    std::sort(times_ms_.begin(), times_ms_.end());
    trips.p50_ms = share_of(times_ms_, 0.5);
    trips.p99_ms = share_of(times_ms_, 0.99);
    trips.p999_ms = share_of(times_ms_, 0.999);
    trips.most_ms = share_of(times_ms_, 1.0);
    // What was sent before the first number may be among those that were overtaken.
    trips.overtaken = std::min(trips.lost, overtaken());
    trips.lost -= trips.overtaken;
    return trips;
  }
  RoundTrips trips;

 private:
  void answered(std::uint32_t number) {
    if (number >= sent_ns_.size() || sent_ns_[number] == 0) return;  // of before the first
    times_ms_.push_back(1e-6 * static_cast<double>(monotonic_ns() - sent_ns_[number]));
    sent_ns_[number] = 0;
    ++trips.answered;
  }

  Link& link_;
  const TripProtocol& protocol_;
  std::uint64_t overtaken_before_;
  std::vector<std::int64_t> sent_ns_;
  std::vector<double> times_ms_;
};

}  // namespace

std::string RoundTrips::json(const std::string& path) const {
  return fmt::format(
      R"({{"path": "{}", "seconds": {:.1f}, "rate_hz": 1000, "scheduling": "{}", "sent": {}, "answered": {}, "overtaken": {}, "lost": {}, )"
      R"("refused": {}, "malformed": {}, "overrun": {}, "late_ticks": {}, )"
      R"("p50_ms": {:.3f}, "p99_ms": {:.3f}, "p99.9_ms": {:.3f}, "max_ms": {:.3f}}})",
      path, seconds, fifo ? "fifo" : "other", sent, answered, overtaken, lost, refused, malformed, overrun,
      late_ticks, p50_ms, p99_ms, p999_ms, most_ms);
}

TripProtocol echo_protocol(std::function<std::uint64_t()> overtaken) {
  constexpr std::size_t kBytes = 16, kNumberAt = 4;
  constexpr std::uint8_t kMark = 0xA7;
  constexpr std::uint32_t kNumbers = 1'000'000;
  const auto command = [](std::uint32_t number) {
    std::vector<std::uint8_t> bytes(kBytes, 0);
    bytes[0] = kMark;
    std::memcpy(bytes.data() + kNumberAt, &number, sizeof number);
    return bytes;
  };
  const auto held = std::make_shared<std::vector<std::uint8_t>>();
  const auto take = [held](std::span<const std::uint8_t> polled,
                           const std::function<void(std::uint32_t)>& answered) {
    for (const std::uint8_t byte : polled) {
      if (held->empty() && byte != kMark) continue;
      held->push_back(byte);
      if (held->size() < kBytes) continue;
      std::uint32_t number = 0;
      std::memcpy(&number, held->data() + kNumberAt, sizeof number);
      held->clear();
      answered(number);
    }
  };
  return {kNumbers, command, take, std::move(overtaken)};
}

RoundTrips measure_round_trips(Link& link, double seconds, const TripProtocol& protocol) {
  TripMeter meter(link, protocol);
  const std::int64_t begun_ns = monotonic_ns(), end_ns = begun_ns + static_cast<std::int64_t>(1e9 * seconds);
  for (std::int64_t next_ns = begun_ns; next_ns < end_ns;) {
    meter.send();
    next_ns += kTripPeriodNs;
    meter.listen_until(next_ns);
    for (; monotonic_ns() > next_ns + kTripPeriodNs; next_ns += kTripPeriodNs)
      ++meter.trips.late_ticks;  // skipped
  }
  // A busy machine keeps the last answers for long. One that does not come at all is lost.
  const Stopwatch waited;
  do meter.listen_until(monotonic_ns() + kTripPeriodNs);
  while (meter.are_under_way() && waited.ms() < kTripPatienceMs);
  meter.trips.seconds = seconds;
  return meter.finished();
}

}  // namespace palpate::device
