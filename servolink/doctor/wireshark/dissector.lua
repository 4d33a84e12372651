-- The dissector itself. `servolink wireshark` writes the tables that it reads in front of it: FIELDS, PACKETS,
-- BIG5 and DEFAULTS. Runs on Lua 5.2 (Wireshark 3 and 4.0 to 4.2) and on Lua 5.4 (since Wireshark 4.4).

local MAGIC = "\19\76\5\29"
local HEADER_SIZE, OVERHEAD = 8, 9
local SIZES = { B = 1, H = 2, h = 2, I = 4, i = 4, ["32s"] = 32 }

local board = Proto("servolink", "Servo Control Board")

-- ── Fields and preferences ──

local makers = {
  B = ProtoField.uint8, h = ProtoField.int16, i = ProtoField.int32, I = ProtoField.uint32,
  ["32s"] = ProtoField.string, data = ProtoField.bytes, group = ProtoField.none,
}
local fields = {
  magic = ProtoField.bytes("servolink.magic", "Magic"),
  packet_id = ProtoField.uint16("servolink.packet_id", "Packet id"),
  packet = ProtoField.string("servolink.packet", "Packet"),
  section = ProtoField.string("servolink.section", "Section of the document"),
  byte_order = ProtoField.string("servolink.byte_order", "Byte order"),
  length = ProtoField.uint16("servolink.length", "Content length"),
  checksum = ProtoField.uint8("servolink.checksum", "Checksum", base.HEX),
  checksum_status = ProtoField.string("servolink.checksum.status", "Checksum status"),
  content = ProtoField.bytes("servolink.content", "Content"),
  noise = ProtoField.bytes("servolink.noise", "Bytes outside of frames"),
  padding = ProtoField.bytes("servolink.padding", "Padding"),
  response_in = ProtoField.framenum("servolink.response_in", "Response in", base.NONE, frametype.RESPONSE),
  response_to = ProtoField.framenum("servolink.response_to", "Response to", base.NONE, frametype.REQUEST),
  repeats = ProtoField.framenum("servolink.repeats", "Repeats the request in", base.NONE, frametype.RETRANS_PREV),
  response_time = ProtoField.relative_time("servolink.response_time", "Time since the request"),
}
local own = {} -- the fields of packets, by name
for _, field in ipairs(FIELDS) do
  local name, kind, meaning = field[1], field[2], field[3]
  if kind == "32s" or kind == "data" or kind == "group" then
    own[name] = makers[kind]("servolink." .. name, name)
  else
    own[name] = makers[kind]("servolink." .. name, name, base.DEC, nil, nil, meaning)
  end
  fields["own_" .. name] = own[name]
end
for _, declared in pairs(PACKETS) do
  local name = declared.group and declared.group.name .. ".count"
  if name and not own[name] then
    own[name] = ProtoField.uint16("servolink." .. name, name)
    fields["own_" .. name] = own[name]
  end
end
board.fields = fields

local experts = {
  checksum = ProtoExpert.new("servolink.checksum.bad", "Wrong checksum", expert.group.CHECKSUM, expert.severity.ERROR),
  content = ProtoExpert.new("servolink.content.bad", "The content contradicts itself", expert.group.MALFORMED, expert.severity.ERROR),
  noise = ProtoExpert.new("servolink.noise.seen", "Bytes outside of frames", expert.group.UNDECODED, expert.severity.WARN),
  unknown = ProtoExpert.new("servolink.packet.unknown", "A packet that the document does not define", expert.group.UNDECODED, expert.severity.NOTE),
  cut = ProtoExpert.new("servolink.cut", "The rest of the frame is missing", expert.group.REASSEMBLE, expert.severity.NOTE),
  unanswered = ProtoExpert.new("servolink.unanswered", "No response was captured", expert.group.SEQUENCE, expert.severity.NOTE),
  failed = ProtoExpert.new("servolink.failed", "The board reports a failure", expert.group.RESPONSE_CODE, expert.severity.NOTE),
}
board.experts = experts

local AUTOMATIC, LITTLE, BIG = 0, 1, 2
local ORDERS = { [AUTOMATIC] = { true, false }, [LITTLE] = { true }, [BIG] = { false } } -- is it little-endian?
local ENCODINGS = { -- number in the preferences, name, and Wireshark's number for it; none for Big5, which is decoded here
  { 0, "UTF-8", ENC_UTF_8 }, { 1, "Big5" }, { 2, "GB18030", ENC_GB18030 },
  { 3, "UTF-16, little-endian", ENC_UTF_16 and ENC_UTF_16 + ENC_LITTLE_ENDIAN },
  { 4, "UTF-16, big-endian", ENC_UTF_16 and ENC_UTF_16 + ENC_BIG_ENDIAN }, { 5, "ISO 8859-1", ENC_ISO_8859_1 },
}
local choices = {}
for at, encoding in ipairs(ENCODINGS) do
  choices[at] = { at, encoding[2], encoding[1] }
end
local prefs = board.prefs
prefs.byte_order = Pref.enum("Byte order of numbers", DEFAULTS.byte_order,
  "Automatic: the order in which id and length of a frame are possible",
  { { 1, "automatic", AUTOMATIC }, { 2, "little-endian", LITTLE }, { 3, "big-endian", BIG } })
prefs.caption_encoding = Pref.enum("Encoding of captions", DEFAULTS.caption_encoding, "The document names none", choices)
prefs.patience = Pref.uint("Longest response time in ms", 3000, "A later response is shown without its request")

-- ── What is known of a conversation, from the first pass through the capture ──

local exchanges -- by frame key: { request, response, seconds, repeats }
local pending -- by conversation: the requests without a response so far, oldest first
local carried -- by packet number: the beginning of a frame, from earlier packets of the same direction
local rests -- by direction: the beginning of a frame whose end has not been captured yet

function board.init()
  exchanges, pending, carried, rests = {}, {}, {}, {}
end

-- ── Numbers, text and sums ──

local function number_at(data, at, little)
  local first, second = data:byte(at + 1, at + 2)
  return little and second * 256 + first or first * 256 + second
end

local function value_at(range, code, little)
  if code == "B" then return range:uint() end
  if code == "h" or code == "i" then return little and range:le_int() or range:int() end
  return little and range:le_uint() or range:uint()
end

local function sum_of(data, at, size)
  local total = 0
  for first = at + 1, at + size, 4096 do -- `byte` returns only so many at once
    for _, byte in ipairs({ data:byte(first, math.min(first + 4095, at + size)) }) do
      total = total + byte
    end
  end
  return total % 256
end

local REPLACEMENT = "\239\191\189" -- U+FFFD

-- Returns the character of two bytes, nil if they are none.
local function big5_character(lead, trail)
  local row = BIG5[lead]
  if not row or not trail then return nil end
  if type(row) == "string" then -- split on first use
    local characters = {}
    for character in row:gmatch("[\1-\127\194-\244][\128-\191]*") do
      characters[#characters + 1] = character
    end
    row, BIG5[lead] = characters, characters
  end
  if trail >= 0x40 and trail <= 0x7E then return row[trail - 0x3F] end
  return trail >= 0xA1 and row[trail - 0x61] or nil
end

local function big5_text(raw)
  local text, at = {}, 1
  while at <= #raw do
    local lead, trail = raw:byte(at, at + 1)
    local character = big5_character(lead, trail)
    text[#text + 1] = lead < 0x80 and string.char(lead) or character or REPLACEMENT
    at = at + (character and 2 or 1)
  end
  return table.concat(text)
end

-- Adds a caption, which ends before the first NUL, and returns its text.
local function add_caption(tree, field, range)
  local encoding = ENCODINGS[prefs.caption_encoding + 1]
  local raw = range:raw()
  local width = encoding[2]:find("UTF-16", 1, true) and 2 or 1
  local size = 0
  while size < #raw and raw:sub(size + 1, size + width) ~= ("\0"):rep(width) do
    size = size + width
  end
  if size == 0 or encoding[2] == "Big5" then
    local text = big5_text(raw:sub(1, size))
    tree:add(field, range, text)
    return text
  end
  local used = range(0, size)
  tree:add_packet_field(field, used, encoding[3] or ENC_UTF_8):set_len(range:len())
  local text = used:string(encoding[3] or ENC_UTF_8)
  -- It is cut after as many bytes as the range has, which may be within a character.
  return #text < size and text or text:gsub("[\194-\244][\128-\191]*$", "")
end

-- ── Where frames are in a stream ──

local function admits(rule, length)
  local base, unit, limit = rule[1], rule[2], rule[3]
  if unit == 0 or length < base then return length == base end
  return (length - base) % unit == 0 and (length - base) / unit <= limit
end

-- Returns what begins at `at`, where the magic stands, in one byte order: nothing, or as `look`.
local function look_for(data, at, little)
  local declared, length = PACKETS[number_at(data, at + 4, little)], number_at(data, at + 6, little)
  local size = length + OVERHEAD
  local is_good = at + size <= #data and sum_of(data, at, size - 1) == data:byte(at + size)
  if not declared then return is_good and "unknown", size, little end
  if not admits(declared.rule, length) then return nil end
  if is_good then return "packet", size, little end
  if at + size > #data then return "cut", at + size - #data, little end
  -- A damaged length swallows frames: search on at the next one inside.
  local inner = data:find(MAGIC, at + 5, true)
  if inner and inner - 1 < at + size then return "noise", inner - 1 - at end
  return "damaged", size, little
end

-- Returns what begins at `at`, where the magic stands: "packet", "unknown", "damaged", "noise", or "cut" if more bytes
-- are needed; then its size, or for "cut" how many bytes are missing, 0 if that is not known yet; then whether its
-- numbers are little-endian.
local function look(data, at)
  if #data - at < HEADER_SIZE then return "cut", 0 end
  local orders = ORDERS[prefs.byte_order]
  local unknown = nil
  for _, little in ipairs(orders) do
    local kind, size = look_for(data, at, little)
    if kind and kind ~= "unknown" then return kind, size, little end
    -- Without content the length is 0 in both orders. The document's ids end in 0 or 1.
    if kind and (not unknown or number_at(data, at + 4, little) % 10 < 2) then unknown = { size, little } end
  end
  if unknown then return "unknown", unknown[1], unknown[2] end
  return "noise", #MAGIC
end

-- Returns where the next frame may begin at or behind `at`: a magic, or the beginning of one at the end.
local function next_start(data, at)
  local found = data:find(MAGIC, at + 1, true)
  if found then return found - 1 end
  for size = math.min(#MAGIC - 1, #data - at), 1, -1 do
    if data:sub(-size) == MAGIC:sub(1, size) then return #data - size end
  end
  return #data
end

-- ── Requests and responses ──

local function accepts(request, response)
  local wanted = request.echoed
  local found = wanted and response.first[wanted]
  if not found or found == 0 then return true end
  local asked = request.first[wanted]
  return asked == found or (wanted == "servo_id" and asked == 255)
end

local function note_request(waiting, frame)
  for at, earlier in ipairs(waiting) do
    if earlier.bytes == frame.bytes then
      exchanges[frame.key].repeats = earlier.number
      table.remove(waiting, at)
      break
    end
  end
  waiting[#waiting + 1] = frame
end

local function note_response(waiting, frame)
  while waiting[1] and (frame.time - waiting[1].time) * 1000 > prefs.patience do
    table.remove(waiting, 1)
  end
  for at, request in ipairs(waiting) do
    if request.packet_id + 1 == frame.packet_id and accepts(request, frame) then
      table.remove(waiting, at)
      exchanges[request.key].response = frame.number
      exchanges[frame.key].request = request.number
      exchanges[frame.key].seconds = frame.time - request.time
      return
    end
  end
end

local function note(conversation, frame)
  exchanges[frame.key] = {}
  pending[conversation] = pending[conversation] or {}
  if frame.declared.from_board then
    note_response(pending[conversation], frame)
  elseif PACKETS[frame.packet_id + 1] then
    note_request(pending[conversation], frame)
  end
end

local function show_exchange(tree, frame, pinfo)
  local exchange = exchanges[frame.key] or {}
  if exchange.repeats then tree:add(fields.repeats, exchange.repeats):set_generated() end
  if exchange.response then tree:add(fields.response_in, exchange.response):set_generated() end
  if exchange.request then
    tree:add(fields.response_to, exchange.request):set_generated()
    local whole = math.floor(exchange.seconds)
    local elapsed = NSTime(whole, math.floor((exchange.seconds - whole) * 1e9 + 0.5))
    tree:add(fields.response_time, elapsed):set_generated()
  end
  local wants_response = not frame.declared.from_board and PACKETS[frame.packet_id + 1]
  if pinfo.visited and wants_response and not exchange.response then
    tree:add_proto_expert_info(experts.unanswered)
  end
end

-- ── The content of packets ──

-- Adds one value and returns its text for summaries.
local function add_value(tree, range, declared, frame)
  local name, code, meanings = declared[1], declared[2], declared[3]
  if code == "32s" then
    return "'" .. add_caption(tree, own[name], range):gsub("%c", ".") .. "'"
  end
  local value = value_at(range, code, frame.little)
  if frame.first[name] == nil then frame.first[name] = value end
  local item = frame.little and tree:add_le(own[name], range) or tree:add(own[name], range)
  if meanings and meanings[value] then item:append_text(" (" .. meanings[value] .. ")") end
  return tostring(value)
end

local function add_values(tree, range, values, frame)
  local at, texts = 0, {}
  for _, declared in ipairs(values) do
    local size = SIZES[declared[2]]
    if at + size <= range:len() then -- the last value of 10031 may be missing
      texts[#texts + 1] = declared[1] .. "=" .. add_value(tree, range(at, size), declared, frame)
      at = at + size
    end
  end
  return table.concat(texts, " "), at
end

local function add_group(tree, content, at, group, frame)
  local size = SIZES[group.count]
  local range = content(at, size)
  local count = value_at(range, group.count, frame.little)
  local field = own[group.name .. ".count"]
  local counted = frame.little and tree:add_le(field, range) or tree:add(field, range)
  at = at + size
  if content:len() ~= at + count * group.size then
    counted:add_proto_expert_info(experts.content, "Another length than this count implies")
    if content:len() > at then tree:add(fields.content, content(at)) end
    return group.name .. "[?]"
  end
  for number = 0, count - 1 do
    local item = content(at + number * group.size, group.size)
    if group.values[1][1] == group.name then -- plain numbers
      add_value(tree, item, group.values[1], frame)
    else
      local branch = tree:add(own[group.name], item)
      local text = add_values(branch, item, group.values, frame)
      branch:set_text(group.name .. "[" .. number .. "]: " .. text)
    end
  end
  return group.name .. "[" .. count .. "]"
end

-- Adds the fields of a packet and returns a summary.
local function add_content(tree, content, frame)
  local declared = frame.declared
  if declared.data then
    if content then tree:add(own[declared.data], content) end
    return declared.data .. "[" .. (content and content:len() or 0) .. "]"
  end
  if not content then return "" end
  local text, at = add_values(tree, content, declared.values, frame)
  if declared.group then
    text = (text == "" and "" or text .. " ") .. add_group(tree, content, at, declared.group, frame)
  end
  return text
end

-- ── Frames ──

local function add_frame(range, pinfo, tree, kind, little, conversation)
  local data = range:raw()
  local packet_id, length = number_at(data, 4, little), number_at(data, 6, little)
  local declared = PACKETS[packet_id] or { name = "unknown packet", values = {}, rule = { 0, 0, 0 } }
  local frame = {
    declared = declared, packet_id = packet_id, little = little, bytes = data, first = {}, time = pinfo.rel_ts,
    number = pinfo.number, echoed = declared.echoed,
    -- The same in each pass: a packet may hold several frames, behind each other and behind a reassembled one.
    key = table.concat({ pinfo.number, range:offset(), range:len(), data:byte(-1) }, ":"),
  }
  local branch = tree:add(board, range)
  branch:set_text("Servo Control Board, " .. declared.name .. " (" .. packet_id .. ")")
  branch:add(fields.magic, range(0, 4))
  local add = little and branch.add_le or branch.add
  add(branch, fields.packet_id, range(4, 2)):append_text(" (" .. declared.name .. ")")
  branch:add(fields.packet, range(4, 2), declared.name):set_generated()
  if declared.section then branch:add(fields.section, range(4, 2), declared.section):set_generated() end
  branch:add(fields.byte_order, range(4, 4), little and "little" or "big"):set_generated()
  add(branch, fields.length, range(6, 2))
  local content = length > 0 and range(HEADER_SIZE, length) or nil
  local summary = ""
  if kind == "unknown" then
    if content then branch:add(fields.content, content) end
    branch:add_proto_expert_info(experts.unknown)
  else
    summary = add_content(branch, content, frame)
  end
  local sum = sum_of(data, 0, #data - 1)
  local checksum = branch:add(fields.checksum, range(#data - 1, 1))
  checksum:add(fields.checksum_status, range(#data - 1, 1), kind == "damaged" and "bad" or "good"):set_generated()
  if kind == "damaged" then
    checksum:add_proto_expert_info(experts.checksum, ("Wrong checksum: the bytes sum to 0x%02x"):format(sum))
    return "[wrong checksum] " .. declared.name
  end
  if declared.is_result and frame.first.result == 0 then branch:add_proto_expert_info(experts.failed) end
  if kind == "packet" then
    if not pinfo.visited then note(conversation, frame) end
    show_exchange(branch, frame, pinfo)
  end
  return declared.name .. (summary == "" and "" or " " .. summary), declared.from_board
end

local function add_noise(range, tree)
  local is_padding = not range:raw():find("[^\0]")
  local branch = tree:add(board, range)
  branch:set_text(("Servo Control Board, %d bytes %s"):format(range:len(), is_padding and "of padding" or "outside of frames"))
  local item = branch:add(is_padding and fields.padding or fields.noise, range)
  if not is_padding then item:add_proto_expert_info(experts.noise) end
  return ("[%d bytes %s]"):format(range:len(), is_padding and "of padding" or "outside of frames")
end

local function add_cut(range, tree, missing)
  local branch = tree:add(board, range)
  branch:set_text("Servo Control Board, the beginning of a frame")
  local lacks = missing > 0 and missing .. " bytes are missing here" or "The rest of its header is missing here"
  branch:add_proto_expert_info(experts.cut, lacks)
end

-- Dissects the frames in `tvb`. Returns a summary, where the last one begins if it is not whole, and how many bytes it lacks.
local function add_stream(tvb, pinfo, tree, conversation)
  local data = tvb:raw()
  local at, noise_at, texts = 0, 0, {}
  local rest, missing, from_board
  while at < #data and not rest do
    local start = next_start(data, at)
    local kind, size, little = "noise", start - at, nil
    if start == at then
      kind, size, little = look(data, at)
    end
    if kind ~= "noise" and noise_at < at then
      texts[#texts + 1] = add_noise(tvb(noise_at, at - noise_at), tree)
    end
    if kind == "cut" then
      rest, missing = at, size
    elseif kind ~= "noise" then
      texts[#texts + 1], from_board = add_frame(tvb(at, size), pinfo, tree, kind, little, conversation)
    end
    at = at + size
    if kind ~= "noise" then noise_at = at end
  end
  if not rest and noise_at < #data then texts[#texts + 1] = add_noise(tvb(noise_at), tree) end
  return table.concat(texts, ", "), rest, missing, from_board
end

-- ── Where the bytes come from ──

-- Fields of other protocols say the same as `pinfo`, but are missing where Wireshark builds no tree.
local PT_TCP, RECEIVED = 2, 1

local function add_over_tcp(tvb, pinfo, tree)
  local ends = { pinfo.src_port .. " " .. tostring(pinfo.src), pinfo.dst_port .. " " .. tostring(pinfo.dst) }
  table.sort(ends)
  local text, rest, missing = add_stream(tvb, pinfo, tree, table.concat(ends, " "))
  if rest and pinfo.can_desegment > 0 then
    pinfo.desegment_offset = rest
    pinfo.desegment_len = missing > 0 and missing or DESEGMENT_ONE_MORE_SEGMENT
  elseif rest then
    add_cut(tvb(rest), tree, missing)
  end
  return text
end

-- Frames on a line may be cut anywhere; each direction is a stream.
local function add_over_line(tvb, pinfo, tree)
  local direction = pinfo.p2p_dir
  if not pinfo.visited then
    carried[pinfo.number], rests[direction] = rests[direction], nil
  end
  local whole, before = tvb, carried[pinfo.number]
  if before then whole = ByteArray.new(before .. tvb:raw(), true):tvb("Reassembled frames") end
  local text, rest, missing, from_board = add_stream(whole, pinfo, tree, "line")
  if rest then
    if not pinfo.visited then rests[direction] = whole:raw(rest) end
    add_cut(whole(rest), tree, missing)
    text = text .. (text == "" and "" or ", ") .. "[the beginning of a frame]"
  end
  if from_board == nil then from_board = direction == RECEIVED end
  pinfo.cols.src, pinfo.cols.dst = from_board and "board" or "host", from_board and "host" or "board"
  return text
end

function board.dissector(tvb, pinfo, tree)
  pinfo.cols.protocol = "Servolink"
  local add = pinfo.port_type == PT_TCP and add_over_tcp or add_over_line
  local text = add(tvb, pinfo, tree)
  if text ~= "" then
    pinfo.cols.info:set(text .. " ")
    pinfo.cols.info:fence() -- further frames of the same segment come behind
  end
  return tvb:len()
end

-- Any port may carry frames: a conversation is one of ours from the first segment on that begins with the magic.
local function is_ours(tvb, pinfo, tree)
  if tvb:len() < #MAGIC or tvb:raw(0, #MAGIC) ~= MAGIC then return false end
  if look(tvb:raw(), 0) == "noise" then return false end
  pinfo.conversation = board
  board.dissector(tvb, pinfo, tree)
  return true
end

board:register_heuristic("tcp", is_ours)
DissectorTable.get("tcp.port"):add_for_decode_as(board)
DissectorTable.get("wtap_encap"):add((wtap_encaps or wtap).USER0, board)
