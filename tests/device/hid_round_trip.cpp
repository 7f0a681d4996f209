#include "tests/device/hid_round_trip.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <vector>

#include "toolkit/core/clock.h"

namespace palpate::device {
namespace {

constexpr std::int64_t kTripPeriodNs = 1'000'000;
constexpr timespec kBetweenLooks{0, 20'000};
constexpr std::size_t kTripBytes = 16;
constexpr std::uint8_t kTripMark = 0xA7;
using TripBytes = std::array<std::uint8_t, kTripBytes>;

double trip_share(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0.0;
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5)];
}

/// Mark, number, blanks: also when torn and glued.
class TripMeter {
 public:
  explicit TripMeter(Link& link, double seconds) : link_(link) {
    sent_ns_.reserve(static_cast<std::size_t>(seconds * 1e3) + 16);
  }
  void send() {
    TripBytes bytes{};
    bytes[0] = kTripMark;
    const auto number = static_cast<std::uint32_t>(sent_ns_.size());
    std::memcpy(bytes.data() + 4, &number, sizeof(number));
    sent_ns_.push_back(monotonic_ns());
    ++trips.sent;
    if (link_.submit(bytes)) return;
    ++trips.refused;
    sent_ns_.back() = 0;
  }
  void listen_until(std::int64_t until_ns) {
    do {
      std::array<std::uint8_t, 65> bytes;
      for (Polled polled = link_.poll(bytes); polled.size > 0; polled = link_.poll(bytes))
        for (std::size_t i = 0; i < polled.size; ++i) take(bytes[i]);
      ::nanosleep(&kBetweenLooks, nullptr);
    } while (monotonic_ns() < until_ns);
  }
  LinkTrips finished(double seconds) {
    for (const std::int64_t sent : sent_ns_) trips.lost += sent != 0 ? 1 : 0;
    std::sort(times_ms_.begin(), times_ms_.end());
    trips.p50_ms = trip_share(times_ms_, 0.5);
    trips.p99_ms = trip_share(times_ms_, 0.99);
    trips.p999_ms = trip_share(times_ms_, 0.999);
    trips.most_ms = trip_share(times_ms_, 1.0);
    trips.seconds = seconds;
    return trips;
  }
  LinkTrips trips;

 private:
  void take(std::uint8_t byte) {
    if (size_ == 0 && byte != kTripMark) return;
    held_[size_++] = byte;
    if (size_ < held_.size()) return;
    size_ = 0;
    std::uint32_t number = 0;
    std::memcpy(&number, held_.data() + 4, sizeof(number));
    if (number >= sent_ns_.size() || sent_ns_[number] == 0) return;
    times_ms_.push_back(1e-6 * static_cast<double>(monotonic_ns() - sent_ns_[number]));
    sent_ns_[number] = 0;
    ++trips.answered;
  }

  Link& link_;
  TripBytes held_{};
  std::size_t size_ = 0;
  std::vector<std::int64_t> sent_ns_;
  std::vector<double> times_ms_;
};

}  // namespace

std::string LinkTrips::json(const std::string& path) const {
  return fmt::format(
      R"({{"path": "{}", "seconds": {:.1f}, "rate_hz": 1000, "sent": {}, "answered": {}, "lost": {}, "replaced": {}, )"
      R"("refused": {}, "late_ticks": {}, "p50_ms": {:.3f}, "p99_ms": {:.3f}, "p99.9_ms": {:.3f}, )"
      R"("max_ms": {:.3f}}})",
      path, seconds, sent, answered, lost, replaced, refused, late_ticks, p50_ms, p99_ms, p999_ms, most_ms);
}

LinkTrips measure_link_trips(Link& link, double seconds, const std::function<std::uint64_t()>& replaced) {
  TripMeter meter(link, seconds);
  const std::int64_t begun_ns = monotonic_ns(), end_ns = begun_ns + static_cast<std::int64_t>(1e9 * seconds);
  for (std::int64_t next_ns = begun_ns; next_ns < end_ns;) {
    meter.send();
    next_ns += kTripPeriodNs;
    meter.listen_until(next_ns);
    for (; monotonic_ns() > next_ns + kTripPeriodNs; next_ns += kTripPeriodNs)
      ++meter.trips.late_ticks;  // skipped
  }
  const Stopwatch waited;
  do meter.listen_until(monotonic_ns() + kTripPeriodNs);
  while (meter.trips.answered + meter.trips.refused + replaced() < meter.trips.sent &&
         waited.ms() < 1e3 * kTripPatienceS);
  meter.trips.replaced = replaced();
  return meter.finished(seconds);
}

}  // namespace palpate::device
