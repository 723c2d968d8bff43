"""The smallest Grounding DINO and SAM 2 that their code allows, with random weights, in folders as users have them."""

from pathlib import Path

SIDE = 64
"""Of the images SAM 2 looks at."""
WORDS = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "?", "a", "towel", "hand"]


def save_sam2(folder: Path) -> Path:
    """Write config.json and weights of a SAM 2 for video."""
    import torch
    import transformers as t

    torch.manual_seed(0)
    backbone = t.Sam2HieraDetConfig(
        hidden_size=8,
        image_size=[SIDE, SIDE],
        embed_dim_per_stage=[8, 16, 32, 64],
        num_attention_heads_per_stage=[1, 1, 2, 2],
        blocks_per_stage=[1, 1, 2, 1],
        global_attention_blocks=[3],
        window_size_per_stage=[4, 4, 4, 4],
        window_positional_embedding_background_size=[4, 4],
    )
    width = 128  # the memory's 64 channels are fixed in the code and must be fewer
    config = t.Sam2VideoConfig(
        vision_config=t.Sam2VisionConfig(
            backbone_config=backbone,
            backbone_channel_list=[64, 32, 16, 8],
            backbone_feature_sizes=[[SIDE // 4] * 2, [SIDE // 8] * 2, [SIDE // 16] * 2],
            fpn_hidden_size=width,
        ),
        prompt_encoder_config=t.Sam2VideoPromptEncoderConfig(
            hidden_size=width, image_size=SIDE, patch_size=16, mask_input_channels=4
        ),
        mask_decoder_config=t.Sam2VideoMaskDecoderConfig(
            hidden_size=width, mlp_dim=16, num_attention_heads=2, iou_head_hidden_dim=16
        ),
        image_size=SIDE,
        memory_attention_hidden_size=width,
        memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=16,
        memory_attention_rope_feat_sizes=[SIDE // 16] * 2,
        memory_encoder_hidden_size=width,
        mask_downsampler_embed_dim=width,
        memory_fuser_num_layers=1,
        memory_fuser_embed_dim=width,
        memory_fuser_intermediate_dim=16,
    )
    t.Sam2VideoModel(config).save_pretrained(folder)
    return folder


def save_grounding_dino(folder: Path) -> Path:
    """Write config.json, weights, tokenizer and image processor of a Grounding DINO."""
    import torch
    import transformers as t

    torch.manual_seed(0)
    config = t.GroundingDinoConfig(
        backbone_config=t.SwinConfig(
            image_size=SIDE,
            window_size=4,
            embed_dim=8,
            depths=[1, 1, 1, 1],
            num_heads=[1, 1, 2, 2],
            out_features=["stage2", "stage3", "stage4"],
        ),
        text_config=t.BertConfig(
            vocab_size=len(WORDS),
            hidden_size=16,
            num_hidden_layers=1,
            num_attention_heads=2,
            intermediate_size=16,
            max_position_embeddings=64,
        ),
        d_model=32,
        num_queries=12,
        encoder_layers=2,
        decoder_layers=2,
        encoder_ffn_dim=16,
        decoder_ffn_dim=16,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        encoder_n_points=2,
        decoder_n_points=2,
        max_text_len=32,
        disable_custom_kernels=True,
    )
    t.GroundingDinoForObjectDetection(config).save_pretrained(folder)
    (folder / "vocab.txt").write_text("\n".join(WORDS))
    images = t.GroundingDinoImageProcessorPil(size={"shortest_edge": 128, "longest_edge": 128})
    t.GroundingDinoProcessor(images, t.BertTokenizer(str(folder / "vocab.txt"))).save_pretrained(folder)
    return folder
