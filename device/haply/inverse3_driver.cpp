// Finds and makes the Inverse3 over real links; apart from its session and texts, which are fuzzed without
// any.
#include <palpate/result.h>
#include "device/haply/inverse3_device.h"
#include "device/interface/driver_options.h"
#include "device/links/udp_link.h"

namespace palpate::device {
namespace {

Status read_centre(const std::string& value, Vec3& centre_mm) {
  constexpr NumberRange kRange{-1000.0, 1000.0};
  std::size_t at = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t end = axis < 2 ? value.find('/', at) : value.size();
    if (end == std::string::npos) return Error{"centre-mm is '" + value + "'", "write X/Y/Z, mm"};
    const Result<double> number = read_number(value.substr(at, end - at), kRange);
    if (!number) return Error{"centre-mm: " + number.error().what, "write X/Y/Z, mm"};
    centre_mm[axis] = *number;
    at = end + 1;
  }
  return Done{};
}

Status take_inverse3_options(Inverse3Options& options, const DeviceRequest& request) {
  const auto take_service = [&options](const std::string& value) -> Status {
    PALPATE_ASSIGN(const UdpAddress address, UdpAddress::of(value));
    options.service.host = address.host;
    options.service.port = address.port;
    return Done{};
  };
  const auto take_centre = [&options](const std::string& value) {
    return read_centre(value, options.centre_mm);
  };
  return take_options(request, "inverse3",
                      {{"service", take_service},
                       number_option("force-gate", options.force_gate, {0.0, 1.0}),
                       switch_option("torque-scaling", options.torque_scaling),
                       {"centre-mm", take_centre},
                       number_option("force-max-n", options.limits.force_max_n, {0.0, 10.0, true})});
}

bool release_inverse3(const Inverse3Options& options) {
  constexpr int kTries = 300;
  const MonotonicClock clock;
  Inverse3Session talk(clock, options.device_id, options.force_gate);
  WebSocketLink link(options.service);
  if (!link.open(talk)) return false;
  for (int i = 0; i < kTries && !talk.zero_sent() && !talk.gone(); ++i) sleep_ms();
  link.close();
  return talk.zero_sent();
}

Result<MadeDevice> make_inverse3(const DeviceRequest& request, const Clock& clock) {
  Inverse3Options options;
  options.name = request.name;
  if (const std::size_t colon = request.name.find(':'); colon != std::string::npos)
    options.device_id = request.name.substr(colon + 1);
  if (!request.description.empty())
    return Error{"the Inverse3 has no description file", "leave it out", request.description.string()};
  PALPATE_TRY(take_inverse3_options(options, request));
  MadeDevice made;
  auto device =
      std::make_unique<Inverse3Device>(std::make_unique<WebSocketLink>(options.service), clock, options);
  made.facts = [device = device.get()] { return device->facts(); };
  made.device = std::move(device);
  made.zero = [options] { return release_inverse3(options); };
  made.unproven = {
      "the Inverse3 was never connected: positions, forces, axes, limits and the service's filters "
      "are as its maker's pages tell"};
  return made;
}

std::vector<DeviceEntry> look_for_inverse3() {
  HttpRequest request;
  request.port = kInverse3Port;
  DeviceEntry entry{
      "inverse3", "Haply Inverse3, through its maker's local service", DeviceStatus::kReady, {}};
  // Any service that answers counts; opening shows what is connected.
  if (!http_request(request)) {
    entry.status = DeviceStatus::kMissing;
    entry.needs = {"the maker's service on port " + std::to_string(kInverse3Port) +
                   ": install the package haply-inverse-service from its maker, then `systemctl start "
                   "haply-inverse-service`"};
  }
  return {entry};
}

}  // namespace

void register_inverse3_driver(Drivers& drivers) {
  drivers.add({"inverse3", "network", look_for_inverse3, make_inverse3});
}

}  // namespace palpate::device
