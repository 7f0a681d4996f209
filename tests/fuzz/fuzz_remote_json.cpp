// Fuzzes JSON requests to a session.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "experiments/live/remote.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using palpate::device::RemoteCommand;
  const std::string_view line(reinterpret_cast<const char*>(data), size);
  const auto command = palpate::experiments::command_of_json(line);
  if (!command) return 0;
  if (command->text.size() > palpate::device::kMaxRemoteText) std::abort();
  if (command->kind == RemoteCommand::Kind::kSelect && (command->number > 0) == !command->text.empty())
    std::abort();
  return 0;
}
