"""Reads a recording with the public Python packages `mcap` and `mcap-protobuf-support`.

Prints one line per message, for recording_foreign_reader.rs to compare with what was written:
floating-point numbers as the hexadecimal bits that came out, so that NaN and -0.0 are compared too.
"""

import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def shown(value):
    if isinstance(value, float):
        return struct.pack(">d", value).hex()
    if isinstance(value, (bytes, bytearray)):
        return value.hex()
    if isinstance(value, (bool, int)):
        return str(int(value))
    if isinstance(value, str):
        return value.replace(" ", "_")
    if hasattr(value, "nanos"):
        return str(value.seconds * 1_000_000_000 + value.nanos)
    return "[" + ",".join(shown(entry) for entry in value) + "]"


with open(sys.argv[1], "rb") as stream:
    reader = make_reader(stream, decoder_factories=[DecoderFactory()])
    summary = reader.get_summary()
    counts = summary.statistics.channel_message_counts
    for channel in sorted(summary.channels.values(), key=lambda channel: channel.topic):
        print("count", channel.topic, counts.get(channel.id, 0))
    for record in reader.iter_metadata():
        for key, value in sorted(record.metadata.items()):
            print("metadata", record.name, key, value)
    for record in reader.iter_attachments():
        print("attachment", record.name, record.media_type, record.data.hex())
    for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
        fields = [f"{f.name}={shown(getattr(decoded, f.name))}" for f in decoded.DESCRIPTOR.fields]
        stamp = f"{message.sequence} {message.log_time} {message.publish_time}"
        print("message", channel.topic, schema.name, stamp, " ".join(fields))
