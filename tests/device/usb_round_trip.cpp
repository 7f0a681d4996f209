#include "tests/device/usb_round_trip.h"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <time.h>

#include <algorithm>
#include <cstdlib>
#include <vector>

#include "device/falcon/falcon_boot.h"
#include "device/falcon/falcon_packets.h"
#include "device/links/usb_link.h"
#include "tests/device/mock/usbfs_double.h"
#include "toolkit/core/clock.h"

namespace palpate::device {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;
constexpr std::int64_t kLastLookNs = 300 * kPeriodNs, kPatienceNs = 10'000 * kPeriodNs;
constexpr timespec kBetweenPolls{0, 50'000};
constexpr int kLoopPriority = 80, kDoublePriority = 82;
constexpr int kNumbers = 4000;  // a command's range; more than can be under way

double share_of(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0.0;
  const auto at = static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5);
  return sorted[at];
}

/// Sends and listens.
class Meter {
 public:
  explicit Meter(UsbLink& link)
      : link_(link), overtaken_before_(link.counters().overtaken), sent_ns_(kNumbers, 0) {}

  void send() {
    const int number = static_cast<int>(result.sent++ % kNumbers);
    FalconCommand command;
    command.motors = {number, 0, 0};
    if (sent_ns_[static_cast<std::size_t>(number)] != 0) ++result.lost;  // never answered, a round ago
    sent_ns_[static_cast<std::size_t>(number)] = monotonic_ns();
    if (link_.submit(encoded(command))) return;
    ++result.refused;
    sent_ns_[static_cast<std::size_t>(number)] = 0;
  }
  void listen_until(std::int64_t until_ns) {
    do {
      std::array<std::uint8_t, kLinkPacketBytes> packet;
      for (Polled polled = link_.poll(packet); polled.size > 0; polled = link_.poll(packet))
        for (const std::uint8_t byte : ftdi_payload(std::span(packet).first(polled.size)))
          if (const auto reply = reader_.take(byte)) answered(*reply);
      ::nanosleep(&kBetweenPolls, nullptr);
    } while (monotonic_ns() < until_ns);
  }
  /// Neither answered nor overtaken until now.
  [[nodiscard]] std::uint64_t under_way() const {
    const auto open = static_cast<std::uint64_t>(
        std::count_if(sent_ns_.begin(), sent_ns_.end(), [](std::int64_t sent) { return sent != 0; }));
    const std::uint64_t overtaken = link_.counters().overtaken - overtaken_before_;
    return result.lost + open > overtaken ? result.lost + open - overtaken : 0;
  }
  RoundTrips finished() {
    for (const std::int64_t sent : sent_ns_) result.lost += sent != 0 ? 1 : 0;
    std::sort(times_ms_.begin(), times_ms_.end());
    result.p50_ms = share_of(times_ms_, 0.5);
    result.p99_ms = share_of(times_ms_, 0.99);
    result.p999_ms = share_of(times_ms_, 0.999);
    result.most_ms = share_of(times_ms_, 1.0);
    result.malformed = reader_.malformed();
    result.overrun = link_.counters().overrun;
    // The probe's last packet may be among those that were overtaken.
    result.overtaken = std::min(result.lost, link_.counters().overtaken - overtaken_before_);
    result.lost -= result.overtaken;
    return result;
  }
  RoundTrips result;

 private:
  void answered(const FalconReply& reply) {
    const auto number = static_cast<std::size_t>(reply.counts[0]);
    if (number >= sent_ns_.size() || sent_ns_[number] == 0) return;  // the probe's
    times_ms_.push_back(1e-6 * static_cast<double>(monotonic_ns() - sent_ns_[number]));
    sent_ns_[number] = 0;
    ++result.answered;
  }

  UsbLink& link_;
  std::uint64_t overtaken_before_;
  FalconReader reader_;
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

RoundTrips measure_round_trips(const RoundTripOptions& options) {
  FalconBoard board;
  board.run_firmware();
  board.echo_motors = true;
  UsbfsDouble usb(board);
  sched_param priority{};
  priority.sched_priority = options.real_time ? kLoopPriority : 0;
  sched_param before{};
  int policy = 0;
  ::pthread_getschedparam(::pthread_self(), &policy, &before);
  const bool fifo =
      options.real_time && ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority) == 0;
  if (fifo) usb.run_at(kDoublePriority);
  UsbLink link({0x0403, 0xCB48, ""}, {}, "falcon", falcon_lets_go, fifo ? UsbLink::kPriority : 0);
  const auto fail = [](const Error& error) {
    fmt::print(stderr, "{}\n", error.message());
    std::abort();
  };
  if (const Status opened = link.open(); !opened) fail(opened.error());
  const auto sleep = [](int ms) {
    const timespec time{0, ms * 1'000'000L};
    ::nanosleep(&time, nullptr);
  };
  const auto booted = boot_falcon(link, {[]() -> Result<FalconFirmware> {
                                           return Error{"it runs", "", "", 0};
                                         },
                                         sleep, options.event_character});
  if (!booted) fail(booted.error());
  Meter meter(link);
  const std::int64_t begun_ns = monotonic_ns(),
                     end_ns = begun_ns + static_cast<std::int64_t>(1e9 * options.seconds);
  for (std::int64_t next_ns = begun_ns; next_ns < end_ns;) {
    meter.send();
    next_ns += kPeriodNs;
    meter.listen_until(next_ns);
    for (; monotonic_ns() > next_ns + kPeriodNs; next_ns += kPeriodNs) ++meter.result.late_ticks;  // skipped
  }
  // A busy machine keeps the last answers for long. One that does not come at all is lost.
  const std::int64_t patient_ns = monotonic_ns() + kPatienceNs;
  do meter.listen_until(monotonic_ns() + kLastLookNs);
  while (meter.under_way() > 0 && monotonic_ns() < patient_ns);
  meter.result.seconds = options.seconds;
  meter.result.fifo = fifo;
  RoundTrips result = meter.finished();
  link.close();
  ::pthread_setschedparam(::pthread_self(), policy, &before);
  return result;
}

}  // namespace palpate::device
