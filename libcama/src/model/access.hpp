// SPDX-License-Identifier: Apache-2.0
// The rooms of the state that a stage may access, declared by its type: class FindContacts : public StageOn<const
// MeshState, ContactState> gets these two rooms, the first read-only, under the names that they have in the state.
#pragma once
#include "model/state.hpp"

namespace cama {

/// A reference to a room of the state, as a member with the room's name.
template <class Room> struct RoomRef;
#define CAMA_ROOM(Type, name)                          \
  template <> struct RoomRef<Type> {                   \
    Type &name;                                        \
    Type &room() const { return name; }                \
    static Type &of(State &s) { return s.name; }       \
  };                                                   \
  template <> struct RoomRef<const Type> {             \
    const Type &name;                                  \
    const Type &room() const { return name; }          \
    static const Type &of(State &s) { return s.name; } \
  };
CAMA_ROOM(Options, options)
CAMA_ROOM(StepReport, report)
CAMA_ROOM(Clock, time)
CAMA_ROOM(MeshState, mesh)
CAMA_ROOM(ElementState, elements)
CAMA_ROOM(ContactState, contact)
CAMA_ROOM(Exemptions, exemptions)
CAMA_ROOM(BoundsState, bounds)
CAMA_ROOM(SystemState, system)
CAMA_ROOM(ReactionState, reactions)
CAMA_ROOM(RigidState, rigid)
#undef CAMA_ROOM

/// Access to some rooms of a state; made from the state, or from an access to more rooms.
template <class... Rooms> struct Access : RoomRef<Rooms>... {
  Access(State &state) : RoomRef<Rooms>{RoomRef<Rooms>::of(state)}..., backend(state.backend) {}
  template <class... More>
  Access(const Access<More...> &more) : RoomRef<Rooms>{pick<Rooms>(more)}..., backend(more.backend)
  {}
  Access(const Access &) = default;

  Backend *backend;

private:
  template <class Room, class Other> static Room &pick(const Other &other)
  {
    if constexpr (std::is_base_of_v<RoomRef<Room>, Other>) {
      return static_cast<const RoomRef<Room> &>(other).room();
    } else {
      using Writable = RoomRef<std::remove_const_t<Room>>;
      static_assert(std::is_base_of_v<Writable, Other>, "needs a room that its caller does not have");
      return static_cast<const Writable &>(other).room();
    }
  }
};

}  // namespace cama
