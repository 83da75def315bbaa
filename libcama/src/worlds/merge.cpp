// SPDX-License-Identifier: Apache-2.0
#include "worlds/merge.hpp"

#include <algorithm>
#include <cstdint>
#include <map>
#include <unordered_map>
#include <utility>

namespace cama {
namespace {

constexpr std::size_t look_ahead = 24;  // units of another sequence that a batch waits for

/// An operation, or a repetition with all that it repeats.
struct Unit {
  std::uint64_t kind;  // equal for equal units
  int begin, length;   // in the queue
};

/// Queues whose operations are equal but for their slots.
struct Sequence {
  std::vector<const OperationQueue *> queues;
  std::vector<Unit> units;
  std::size_t at = 0;
  bool ended() const { return at == units.size(); }
  const Unit &head() const { return units[at]; }
  /// Whether a unit of this kind comes soon, but not next.
  bool awaits(std::uint64_t kind) const
  {
    const std::size_t end = std::min(units.size(), at + look_ahead);
    for (std::size_t u = at + 1; u < end; ++u)
      if (units[u].kind == kind) return true;
    return false;
  }
};

class Merger {
public:
  explicit Merger(const std::vector<const OperationQueue *> &queues)
  {
    std::unordered_map<std::uint64_t, std::size_t> found;
    for (const OperationQueue *queue : queues) {
      if (queue->empty()) continue;
      const auto [place, added] = found.emplace(queue->hash() + static_cast<std::uint64_t>(queue->size()),
                                                sequences_.size());
      if (added) sequences_.emplace_back();
      sequences_[place->second].queues.push_back(queue);
    }
    for (Sequence &s : sequences_) divide(s);
    std::vector<std::size_t> chosen;
    for (std::uint64_t kind = 0; next(kind);) {
      chosen.clear();
      for (std::size_t s = 0; s < sequences_.size(); ++s)
        if (!sequences_[s].ended() && sequences_[s].head().kind == kind) chosen.push_back(s);
      emit(chosen);
      for (const std::size_t s : chosen) ++sequences_[s].at;
    }
  }
  Plan take() { return std::move(plan_); }

private:
  static void divide(Sequence &s)
  {
    const OperationQueue &queue = *s.queues.front();
    for (int i = 0; i < queue.size();) {
      const Operation &first = queue.operation(i);
      const int length = first.kind == OperationKind::repeat ? 1 + first.extra : 1;
      std::uint64_t hash = 0;
      for (int j = i; j < i + length; ++j) hash = queue.operation(j).hash(hash);
      s.units.push_back({hash, i, length});
      i += length;
    }
  }

  /// Chooses the kind that the fewest other worlds have soon, but not next; of these that of the most worlds. Returns
  /// false at the end of all.
  bool next(std::uint64_t &kind) const
  {
    std::vector<std::pair<std::uint64_t, std::size_t>> heads;
    for (const Sequence &s : sequences_) {
      if (s.ended()) continue;
      const auto known =
          std::find_if(heads.begin(), heads.end(), [&](const auto &head) { return head.first == s.head().kind; });
      if (known == heads.end())
        heads.emplace_back(s.head().kind, s.queues.size());
      else
        known->second += s.queues.size();
    }
    std::size_t best_later = 0, best_now = 0;
    for (const auto &[candidate, now] : heads) {
      std::size_t later = 0;
      if (heads.size() > 1)
        for (const Sequence &s : sequences_)
          if (!s.ended() && s.head().kind != candidate && s.awaits(candidate)) later += s.queues.size();
      if (best_now > 0 && (later > best_later || (later == best_later && now <= best_now))) continue;
      kind = candidate;
      best_later = later;
      best_now = now;
    }
    return !heads.empty();
  }

  /// Adds the batches of the units that these sequences are at.
  void emit(const std::vector<std::size_t> &chosen)
  {
    const Unit &unit = sequences_[chosen.front()].head();
    const OperationQueue &model = *sequences_[chosen.front()].queues.front();
    const bool repeated = model.operation(unit.begin).kind == OperationKind::repeat;
    std::vector<int> times;  // [worlds of the group], descending
    const int group = repeated ? repeated_group(chosen, times) : group_of(chosen);
    const int first = static_cast<int>(plan_.batches.size());
    for (int i = repeated ? 1 : 0; i < unit.length; ++i) {
      Plan::Batch &batch = plan_.batches.emplace_back();
      batch.what = model.operation(unit.begin + i);
      batch.group = group;
      for (const std::size_t s : chosen) batch.at.push_back(sequences_[s].head().begin + i);
    }
    const int last = static_cast<int>(plan_.batches.size());
    if (!repeated) return plan_.order.push_back({first, plan_.worlds(plan_.batches.back())});
    int worlds = static_cast<int>(times.size());
    for (int time = 0; worlds > 0; ++time) {
      while (worlds > 0 && times[static_cast<std::size_t>(worlds - 1)] <= time) --worlds;
      for (int b = first; worlds > 0 && b < last; ++b) plan_.order.push_back({b, worlds});
    }
  }

  int group_of(const std::vector<std::size_t> &chosen)
  {
    const auto [place, added] = groups_.emplace(chosen, static_cast<int>(plan_.groups.size()));
    if (added) {
      Plan::Group &group = plan_.groups.emplace_back();
      for (std::size_t c = 0; c < chosen.size(); ++c)
        for (const OperationQueue *queue : sequences_[chosen[c]].queues) {
          group.worlds.push_back(queue);
          group.sequence.push_back(static_cast<int>(c));
        }
    }
    return place->second;
  }

  int repeated_group(const std::vector<std::size_t> &chosen, std::vector<int> &times)
  {
    struct Member {
      const OperationQueue *queue;
      int sequence, times;
    };
    std::vector<Member> members;
    for (std::size_t c = 0; c < chosen.size(); ++c)
      for (const OperationQueue *queue : sequences_[chosen[c]].queues)
        members.push_back(
            {queue, static_cast<int>(c), from_slot<int>(*queue->slots(sequences_[chosen[c]].head().begin))});
    std::stable_sort(members.begin(), members.end(),
                     [](const Member &a, const Member &b) { return a.times > b.times; });
    Plan::Group &group = plan_.groups.emplace_back();
    for (const Member &m : members) {
      group.worlds.push_back(m.queue);
      group.sequence.push_back(m.sequence);
      times.push_back(m.times);
    }
    return static_cast<int>(plan_.groups.size()) - 1;
  }

  std::vector<Sequence> sequences_;
  std::map<std::vector<std::size_t>, int> groups_;
  Plan plan_;
};

}  // namespace

Plan merge(const std::vector<const OperationQueue *> &queues) { return Merger(queues).take(); }

}  // namespace cama
