#include "device/bridge/bridge_driver.h"

#include <time.h>

#include "device/bridge/bridge_device.h"
#include "device/interface/device_facts.h"
#include "device/links/udp_link.h"
#include "toolkit/core/options.h"
#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

constexpr double kSPerMs = 1e-3;

/// Of "bridge:HOST:PORT" or "bridge:HOST".
Result<UdpAddress> bridge_address(const std::string& name) {
  static const std::string kPrefix = "bridge:";
  if (!name.starts_with(kPrefix) || name.size() == kPrefix.size())
    return Error{"'" + name + "' names no far end", "write bridge:HOST:PORT", "", 0};
  std::string where = name.substr(kPrefix.size());
  const bool bare = where.find(':') == std::string::npos || where.back() == ']';
  if (bare) where += ":" + std::to_string(kBridgePort);
  return UdpAddress::of(where);
}

Result<MadeDevice> make_bridge(const DeviceRequest& request, const Clock& clock) {
  PALPATE_ASSIGN(const UdpAddress address, bridge_address(request.name));
  if (!request.description.empty())
    return Error{"the bridge has no description file", "give it to the far end", request.description.string(),
                 0};
  BridgeOptions options;
  options.name = request.name;
  options.session = new_session();
  for (const auto& [key, value] : request.options) {
    constexpr NumberRange kAges{1.0, 1000.0};
    if (key != "most-age-ms")
      return Error{"the bridge has no option '" + key + "'", "it has most-age-ms", "", 0};
    const Result<double> ms = read_number(value, kAges);
    if (!ms) return Error{"most-age-ms: " + ms.error().what, "", "", 0};
    options.most_age_s = kSPerMs * *ms;
  }
  MadeDevice made;
  auto device = std::make_unique<BridgeDevice>(std::make_unique<UdpLink>(address), clock, options);
  made.facts = [held = device.get()] {
    const BridgeCounters& counted = held->counters();
    DeviceFacts facts = {{"far_device", std::string(held->welcome().name())}};
    add_counts(facts, {{"states", counted.states},
                       {"states_malformed", counted.malformed},
                       {"states_overtaken", counted.overtaken},
                       {"states_old", counted.old},
                       {"states_disobeying", counted.disobeying},
                       {"states_lost", counted.lost}});
    constexpr std::int64_t kNsPerUs = 1000;
    facts.emplace_back("round_trip_newest_us", std::to_string(counted.round_trip_ns / kNsPerUs));
    return facts;
  };
  made.device = std::move(device);
  made.zero = [where = address.text()] { return release_far_end(where); };
  made.homing_prompt = [](std::uint8_t) {
    return std::string("Home the device at the other machine, as `palpate bridge` tells there");
  };
  made.unproven = {
      "the bridge was run on one machine and on a pretended network, never between two machines"};
  return made;
}

}  // namespace

bool release_far_end(const std::string& host_and_port) {
  const Result<UdpAddress> address = UdpAddress::of(host_and_port);
  if (!address) return false;
  UdpLink link(*address);
  if (!link.open()) return false;
  Datagram release;
  release.kind = DatagramKind::kRelease;
  const DatagramBytes bytes(release);
  constexpr int kTries = 50, kEvery = 10;  // a millisecond apart; asked again every ten
  constexpr timespec kWait{0, 1'000'000};
  for (int i = 0; i < kTries; ++i) {
    if (i % kEvery == 0) link.submit(bytes.bytes());
    ::nanosleep(&kWait, nullptr);
    std::array<std::uint8_t, kMostDatagramBytes + 1> into;
    const Polled polled = link.poll(into);
    const auto answer = decoded_datagram(std::span<const std::uint8_t>(into).first(polled.size));
    if (answer && answer->kind == DatagramKind::kReleased) return true;
  }
  return false;
}

void register_bridge_driver(Drivers& drivers) {
  drivers.add(
      {"bridge", "network",
       [] {
         return std::vector<DeviceEntry>{
             {"bridge:HOST:PORT",
              "a device at another machine, over UDP",
              DeviceStatus::kMissing,
              {"a far end: run `palpate bridge --device NAME --listen ADDRESS:PORT` on that machine"}}};
       },
       make_bridge});
}

}  // namespace palpate::device
