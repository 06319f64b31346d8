#include "rendering/workspace.h"

#include <cstddef>
#include <mutex>
#include <utility>

namespace mattgs {
namespace {

std::mutex free_mutex;
std::vector<std::unique_ptr<Workspace>>& free_workspaces() {
    static auto* list = new std::vector<std::unique_ptr<Workspace>>;
    return *list;
}
constexpr std::size_t KEPT_WORKSPACES = 2;

}  // namespace

std::unique_ptr<Workspace> take_workspace() {
    const std::lock_guard<std::mutex> lock(free_mutex);
    auto& list = free_workspaces();
    if (list.empty()) return std::make_unique<Workspace>();
    auto last = std::move(list.back());
    list.pop_back();
    return last;
}

void give_workspace(std::unique_ptr<Workspace> workspace) {
    const std::lock_guard<std::mutex> lock(free_mutex);
    auto& list = free_workspaces();
    if (list.size() < KEPT_WORKSPACES) list.push_back(std::move(workspace));
}

int64_t Workspace::bytes() const {
    int64_t sum = unsorted.bytes() + sorted.bytes() + depths.bytes() + colours.bytes() +
                  extra.bytes() + slots.bytes() + keys.bytes() + keys_spare.bytes() +
                  order.bytes() + slots_of.bytes() + pairs.bytes() + pixels.bytes();
    for (const Chunk& c : chunks) sum += c.pairs.bytes();
    return sum;
}

}  // namespace mattgs
