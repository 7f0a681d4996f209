// Fuzzes Open Sound Control messages and bundles, and their requests to a session.
#include <cstdint>
#include <span>
#include <string_view>

#include "device/live/remote_command.h"
#include "tests/fuzz/must.h"

namespace palpate::device {
namespace {

bool lies_in(std::string_view text, std::span<const std::uint8_t> bytes) {
  const auto* const begin = reinterpret_cast<const char*>(bytes.data());
  return text.empty() || (text.data() >= begin && text.data() + text.size() <= begin + bytes.size());
}

void check_osc_message(const OscMessage& message, std::span<const std::uint8_t> bytes) {
  must(message.address.starts_with('/') && lies_in(message.address, bytes));
  must(message.count <= OscMessage::kMaxArguments);
  for (std::size_t i = 0; i < message.count; ++i) must(lies_in(message.arguments[i].text, bytes));
  const auto command = command_of(message);
  if (!command) return;
  must(command->text.size() <= kMaxRemoteText);
  if (command->kind == RemoteCommand::Kind::kSelect) must((command->number > 0) != !command->text.empty());
}

}  // namespace
}  // namespace palpate::device

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::device;
  using palpate::must;
  const std::span<const std::uint8_t> bytes(data, size);
  const auto message = read_osc(bytes);
  const auto messages = read_osc_packet(bytes);
  if (message) must(messages && messages->size() == 1);
  if (!messages) return 0;
  must(size % 4 == 0);
  // Each needs at least its length and one word.
  must(messages->size() <= size / 4);
  for (const OscMessage& one : *messages) check_osc_message(one, bytes);
  return 0;
}
